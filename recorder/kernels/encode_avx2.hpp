// The model felics in 16-bit lanes, 32 pixels a step.
#pragma once

#include <cstdint>

#include "bits.hpp"
#include "code.hpp"

namespace recorder::avx2 {

// Up to this depth every code word's value fits 16 bits, and a narrower image is no work for vectors.
constexpr std::uint32_t deepest_encoded = 14;
constexpr std::uint32_t narrowest_encoded = 32;

// Appends one row that has a row above it, and returns `crc` (a running CRC-32C register) moved on over
// its pixels. All pixels are below 2^depth. Reads the pixel before the row, which is the row above's last.
std::uint32_t encode_row(BitWriter &writer, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth,
                         const KTable &table, std::uint32_t crc);

// Appends the pixels of a row as they are, up to deepest_encoded bits each.
void pack_row(BitWriter &writer, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth);

// All pixels' bits together.
std::uint32_t bits_in_use(const std::uint16_t *row, std::uint32_t width);

}  // namespace recorder::avx2
