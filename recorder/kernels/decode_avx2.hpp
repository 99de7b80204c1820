// The model felics decoded 32 rows at once.
#pragma once

#include <cstdint>

#include "felics.hpp"

namespace recorder::avx2 {

// Where a stream is read and where it ends, both in bits of the unstuffed payload.
struct StreamEnds {
    std::uint32_t bit, end;
};

// Whether decode_rows can be used.
bool decodes(const Header &header);

// Bytes that it may read behind the payload, which are to be zero.
constexpr std::size_t decode_slack = 16;

constexpr std::size_t sink_slack = 8;

// Decodes all rows but the topmost, whose stream stands behind it in `streams`, and moves the streams on.
// False if anything is wrong: then the pixels and streams are void. `sink` has room for one row and sink_slack
// pixels.
bool decode_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                 StreamEnds (&streams)[written_streams]);

}  // namespace recorder::avx2
