// In place of cpu.cpp and vector_kernels.cpp: the set of instructions can be changed at any time.
#include "fuzz.hpp"
#include "vector_kernels.hpp"

namespace recorder {

#if RECORDER_HAS_WIDE
namespace avx2 {
extern const VectorKernels kernels;
}
namespace avx512 {
extern const VectorKernels kernels;
}

namespace {

bool has_avx2() { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2"); }

bool has_avx512() {
#if defined(RECORDER_EMULATED_AVX512)  // tools/emulate_avx512.sh: then AVX2 does for it
    return true;
#else
    return __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512cd") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
#endif
}

}  // namespace
#endif

std::vector<InstructionSet> sets_of_this_processor() {
    std::vector<InstructionSet> sets = {InstructionSet::scalar};
#if RECORDER_HAS_WIDE
    if (has_avx2()) sets.push_back(InstructionSet::avx2);
    if (has_avx2() && has_avx512()) sets.push_back(InstructionSet::avx512);
#endif
    return sets;
}

InstructionSet set_in_use = InstructionSet::scalar;

#if RECORDER_HAS_WIDE
InstructionSet instruction_set() { return set_in_use; }

const VectorKernels *vector_kernels() {
    switch (set_in_use) {
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
