// What encoder and training ask of a row of pixels.
#pragma once

#include <cstdint>

namespace recorder {

// Throws ArgumentError for a value above the depth.
void check_row(const std::uint16_t *row, std::uint32_t width, std::uint32_t depth);

}  // namespace recorder
