#include "vector_kernels.hpp"

#include "cpu.hpp"

namespace recorder {

#if RECORDER_HAS_WIDE

namespace avx2 {
extern const VectorKernels kernels;
}

const VectorKernels *vector_kernels() {
    static const VectorKernels *const chosen = has_wide() ? &avx2::kernels : nullptr;
    return chosen;
}

#else

const VectorKernels *vector_kernels() { return nullptr; }

#endif

}  // namespace recorder
