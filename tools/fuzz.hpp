// What both fuzz targets need: buffers of exactly their size, so that the sanitizers see every byte read or
// written outside, and each kernel with every set of instructions.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "cpu.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "stuffing.hpp"

namespace recorder {

using Bytes = std::vector<std::uint8_t>;

inline void require(bool holds, const char *what) {
    if (holds) return;
    std::fprintf(stderr, "does not hold: %s\n", what);
    std::abort();
}

template <typename T>
std::unique_ptr<T[]> exact(const T *source, std::size_t count) {
    std::unique_ptr<T[]> copy(new T[count]);
    std::copy_n(source, count, copy.get());
    return copy;
}

// The sets that this processor has, the scalar one first, and the one that the kernels use now.
std::vector<InstructionSet> sets_of_this_processor();
extern InstructionSet set_in_use;

// What `kernel` returns with the scalar set, which it must return with every other one as well.
template <typename Kernel>
auto with_every_set(const char *what, Kernel kernel) {
    static const std::vector<InstructionSet> sets = sets_of_this_processor();
    set_in_use = sets.front();
    const auto expected = kernel();
    for (std::size_t i = 1; i < sets.size(); ++i) {
        set_in_use = sets[i];
        require(kernel() == expected, what);
    }
    set_in_use = sets.front();
    return expected;
}

// An image decoded, or why not.
struct Outcome {
    std::vector<std::uint16_t> pixels;
    const char *error = nullptr;
    std::size_t offset = 0;

    bool operator==(const Outcome &other) const {
        return pixels == other.pixels && offset == other.offset &&
               (error == nullptr) == (other.error == nullptr) &&
               (error == nullptr || std::string(error) == other.error);
    }
    bool failed_by(const char *what) const { return error != nullptr && std::string(error) == what; }
};

// Where only the checksum of the pixels is wrong they are returned beside the error.
inline Outcome decode(const std::uint8_t *data, std::size_t size) {
    Outcome result;
    std::unique_ptr<std::uint16_t[]> pixels;
    std::size_t count = 0;
    try {
        const Header header = parse_image(data, size).header;
        count = std::size_t{header.width} * header.height;
        require(count <= 8 * size, "no picture has more pixels than eight times its bytes");
        pixels.reset(new std::uint16_t[count]);
        decode(pixels.get(), count, data, size);
    } catch (const FormatError &error) {
        require(error.offset <= size, "an error is inside the image");
        result.error = error.what;
        result.offset = error.offset;
    }
    if (result.error == nullptr || result.failed_by("the pixels' checksum is wrong"))
        result.pixels.assign(pixels.get(), pixels.get() + count);
    return result;
}

inline Outcome decode_with_every_set(const Bytes &image) {
    const auto data = exact(image.data(), image.size());
    return with_every_set("all sets decode alike", [&] { return decode(data.get(), image.size()); });
}

// An image, empty if an argument was refused.
inline Bytes encode_with_every_set(const std::vector<std::uint16_t> &pixels, std::uint32_t width,
                                   std::uint32_t height, std::uint32_t depth, Model model,
                                   const std::uint8_t *table) {
    const auto source = exact(pixels.data(), pixels.size());
    return with_every_set("all sets encode alike", [&]() -> Bytes {
        const std::size_t room = largest_encoding(width, height, depth);
        const std::unique_ptr<std::uint8_t[]> target(new std::uint8_t[room]);
        try {
            // and on any number of threads
            const std::uint32_t threads = set_in_use == InstructionSet::scalar ? 1 : 1 + height % 4;
            const std::size_t size = encode(target.get(), source.get(), width, height, depth, model, table, threads);
            require(size <= room, "no image is larger than the largest");
            return Bytes(target.get(), target.get() + size);
        } catch (const ArgumentError &) {
            return {};
        }
    });
}

}  // namespace recorder
