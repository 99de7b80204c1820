#include "append_vector.hpp"
#include "vector_set.hpp"

namespace recorder::RECORDER_VECTOR {

const VectorKernels kernels = {step_pixels, encode_row,  encode_ls_row,  pack_row, bits_in_use, decodes,
                               decodes_ls,  decode_rows, decode_ls_rows, stuff,    unstuff};

}  // namespace recorder::RECORDER_VECTOR
