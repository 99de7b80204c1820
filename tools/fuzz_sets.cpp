// In place of cpu.cpp and vector_kernels.cpp: the set of instructions can be changed at any time.
#include "fuzz.hpp"
#include "vector_kernels.hpp"

namespace recorder {

#if RECORDER_HAS_WIDE
namespace avx2 {
extern const VectorKernels kernels;
}
#endif

std::vector<InstructionSet> sets_of_this_processor() {
    std::vector<InstructionSet> sets = {InstructionSet::scalar};
#if RECORDER_HAS_WIDE
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2")) sets.push_back(InstructionSet::avx2);
#endif
    return sets;
}

InstructionSet set_in_use = InstructionSet::scalar;

#if RECORDER_HAS_WIDE
InstructionSet instruction_set() { return set_in_use; }

const VectorKernels *vector_kernels() {
    return set_in_use == InstructionSet::avx2 ? &avx2::kernels : nullptr;
}
#else
const VectorKernels *vector_kernels() { return nullptr; }
#endif

}  // namespace recorder
