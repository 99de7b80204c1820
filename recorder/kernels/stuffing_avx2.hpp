// Stuffing, unstuffing and looking for markers, vectors at a time; the last bytes are left to the caller.
#pragma once

#include <cstddef>
#include <cstdint>

namespace recorder::avx2 {

// What is still to be done of a stuffing or unstuffing, moved on by the functions below.
struct Span {
    std::uint8_t *target;
    const std::uint8_t *source;
    std::size_t size;  // bytes of source
};

// Stuffs XORed bytes. False if more than `extra` bytes had to be added, which counts down.
bool stuff(Span &span, std::uint8_t mask, std::size_t &extra);

// Unstuffs; stops early at an FF that no 00 follows.
void unstuff(Span &span, std::uint8_t mask);

// The position of the next FF E8 or FF E9 at or after `from`, or one before which there is none.
std::size_t next_marker(const std::uint8_t *data, std::size_t size, std::size_t from);

}  // namespace recorder::avx2
