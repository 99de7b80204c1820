// The model felics-ls decoded 32 rows at once; as decode_avx2.hpp.
#pragma once

#include "decode_avx2.hpp"

namespace recorder::avx2 {

bool decodes_ls(const Header &header);

bool decode_ls_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                    StreamEnds (&streams)[written_streams]);

}  // namespace recorder::avx2
