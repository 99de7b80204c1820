// The kernels of the set that this file is compiled for: what each does stands in vector_kernels.hpp.
#pragma once

#include "lanes.hpp"
#include "vector_kernels.hpp"

namespace recorder::RECORDER_VECTOR {

EncodeRow encode_row;
EncodeLsRow encode_ls_row;
PackRow pack_row;
BitsInUse bits_in_use;
Decodes decodes, decodes_ls;
DecodeRows decode_rows, decode_ls_rows;
Stuff stuff;
Unstuff unstuff;

extern const VectorKernels kernels;

}  // namespace recorder::RECORDER_VECTOR
