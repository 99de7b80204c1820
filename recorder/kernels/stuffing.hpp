// Byte stuffing (report 3.2.7.1): inside the markers every FF is followed by 00.
#pragma once

#include <cstddef>
#include <cstdint>

namespace recorder {

constexpr std::uint8_t marker_prefix = 0xFF;
constexpr std::uint8_t start_of_image = 0xE8;
constexpr std::uint8_t end_of_image = 0xE9;

// Writes every byte of `source` XOR `mask`, stuffed, and moves `target` on behind them. Counts `extra` down by
// the bytes added: false if there were more (then what was written is void).
bool stuff(std::uint8_t *&target, const std::uint8_t *source, std::size_t size, std::uint8_t mask,
           std::size_t &extra);

// Undoes stuff() on `size` bytes that stand at byte `offset` of an image; returns the bytes written,
// at most `size`. Throws FormatError if an FF is not followed by 00.
std::size_t unstuff(std::uint8_t *target, const std::uint8_t *source, std::size_t size, std::uint8_t mask,
                    std::size_t offset);

// Where in `source` the unstuffed byte number `index` stands.
std::size_t stuffed_position(const std::uint8_t *source, std::size_t size, std::size_t index);

// The position of the next FF E8 or FF E9 at or after `from`, or `size` if there is none.
std::size_t next_marker(const std::uint8_t *data, std::size_t size, std::size_t from);

}  // namespace recorder
