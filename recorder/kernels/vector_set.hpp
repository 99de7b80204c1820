// The kernels of the set that this file is compiled for: what each does stands in vector_kernels.hpp.
#pragma once

#include "lanes.hpp"
#include "vector_kernels.hpp"

namespace recorder {

// Compiled for AVX2 alone, and in every set.
namespace avx2 {
Decodes decodes, decodes_ls;
DecodeRows decode_rows, decode_ls_rows;
}  // namespace avx2

namespace RECORDER_VECTOR {

EncodeRow encode_row;
EncodeLsRow encode_ls_row;
PackRow pack_row;
BitsInUse bits_in_use;
Stuff stuff;
Unstuff unstuff;
NextMarker next_marker;

extern const VectorKernels kernels;

}  // namespace RECORDER_VECTOR
}  // namespace recorder
