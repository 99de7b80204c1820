// One piece of work on several threads.
#pragma once

#include <array>
#include <cstdint>
#include <exception>
#include <thread>

namespace recorder {

constexpr std::uint32_t most_threads = 32;  // as many as an image has streams

// work(0) to work(count - 1), each on a thread of its own and the first on the caller's; returns when all are done
// and throws what the first of them threw. Starting a thread takes some 20 us, and a process that forks or ends
// finds none left over.
template <typename Work>
void in_parallel(std::uint32_t count, const Work &work) {
    std::array<std::exception_ptr, most_threads> faults{};
    std::array<std::thread, most_threads> others;
    const auto guarded = [&](std::uint32_t part) {
        try {
            work(part);
        } catch (...) {
            faults[part] = std::current_exception();
        }
    };
    for (std::uint32_t part = 1; part < count; ++part) {
        try {
            others[part] = std::thread(guarded, part);
        } catch (const std::exception &) {  // no more threads are to be had
            guarded(part);
        }
    }
    guarded(0);
    for (std::thread &other : others)
        if (other.joinable()) other.join();
    for (const std::exception_ptr &fault : faults)
        if (fault != nullptr) std::rethrow_exception(fault);
}

}  // namespace recorder
