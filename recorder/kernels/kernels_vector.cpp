#include "append_vector.hpp"
#include "vector_set.hpp"

namespace recorder::RECORDER_VECTOR {

const VectorKernels kernels = {step_pixels,          encode_row,    encode_ls_row,    pack_row,
                               bits_in_use,          avx2::decodes, avx2::decodes_ls, avx2::decode_rows,
                               avx2::decode_ls_rows, stuff,         unstuff,          next_marker};

}  // namespace recorder::RECORDER_VECTOR
