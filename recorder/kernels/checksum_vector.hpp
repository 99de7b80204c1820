// CRC-32C fused into the loop that reads the pixels anyway: its serial chain, 24 cycles for 32 pixels, hides
// behind the vector work.
#pragma once

#include <immintrin.h>

#include <cstdint>
#include <cstring>

#include "append_vector.hpp"

namespace recorder::RECORDER_VECTOR {

RECORDER_INLINE std::uint64_t checksum_step(std::uint64_t crc, const std::uint16_t *pixels) {
    for (std::uint32_t i = 0; i < step_pixels; i += 4) {
        std::uint64_t word;
        std::memcpy(&word, pixels + i, sizeof word);
        crc = _mm_crc32_u64(crc, word);
    }
    return crc;
}

inline std::uint64_t checksum_rest(std::uint64_t crc, const std::uint16_t *pixels, std::uint32_t count) {
    for (std::uint32_t i = 0; i < count; ++i) crc = _mm_crc32_u16(static_cast<std::uint32_t>(crc), pixels[i]);
    return crc;
}

}  // namespace recorder::RECORDER_VECTOR
