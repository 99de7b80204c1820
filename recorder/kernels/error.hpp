// What the kernels throw when bytes are not a sound image, or an image cannot be encoded.
#pragma once

#include <cstddef>

namespace recorder {

// Bytes that are not a sound FELICS image: what is wrong, and at which byte of the image.
struct FormatError {
    const char *what;
    std::size_t offset;
};

// Something the caller must not ask for (becomes ValueError).
struct ArgumentError {
    const char *what;
};

}  // namespace recorder
