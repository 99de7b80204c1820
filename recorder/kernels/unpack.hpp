// Cameras' packed pixel formats (GenICam PFNC).
#pragma once

#include <cstddef>
#include <cstdint>

namespace recorder {

// Mono10p: ten bits a pixel, least significant bit first, without gaps. Reads (10 * count + 7) / 8 bytes.
void unpack_mono10p(std::uint16_t *pixels, std::size_t count, const std::uint8_t *packed);

}  // namespace recorder
