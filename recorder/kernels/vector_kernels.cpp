#include "vector_kernels.hpp"

#include "cpu.hpp"

namespace recorder {

#if RECORDER_HAS_WIDE

namespace avx2 {
extern const VectorKernels kernels;
}
namespace avx512 {
extern const VectorKernels kernels;
}

const VectorKernels *vector_kernels() {
    switch (instruction_set()) {
        case InstructionSet::avx512: return &avx512::kernels;
        case InstructionSet::avx2: return &avx2::kernels;
        case InstructionSet::scalar: break;
    }
    return nullptr;
}

#else

const VectorKernels *vector_kernels() { return nullptr; }

#endif

}  // namespace recorder
