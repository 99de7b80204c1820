#include "cpu.hpp"

#include <cstdlib>
#include <cstring>

#include "error.hpp"

namespace recorder {
namespace {

constexpr InstructionSet all_sets[] = {InstructionSet::scalar, InstructionSet::avx2, InstructionSet::avx512};

#if RECORDER_HAS_WIDE
bool has_avx2() {
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") &&
           __builtin_cpu_supports("lzcnt") && __builtin_cpu_supports("movbe");
}

bool has_avx512() {
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
}
#endif

InstructionSet best() {
#if RECORDER_HAS_WIDE
    if (has_avx2()) return has_avx512() ? InstructionSet::avx512 : InstructionSet::avx2;
#endif
    return InstructionSet::scalar;
}

InstructionSet chosen() {
    const char *wanted = std::getenv("RECORDER_KERNELS");
    if (wanted == nullptr) return best();
    for (const InstructionSet set : all_sets) {
        if (std::strcmp(wanted, name_of(set)) != 0) continue;
        if (set > best()) throw ArgumentError{"RECORDER_KERNELS asks for instructions that this processor lacks"};
        return set;
    }
    throw ArgumentError{"RECORDER_KERNELS is scalar, avx2 or avx512; unset, the best that the processor has"};
}

}  // namespace

InstructionSet instruction_set() {
    static const InstructionSet set = chosen();
    return set;
}

const char *name_of(InstructionSet set) {
    switch (set) {
        case InstructionSet::avx512: return "avx512";
        case InstructionSet::avx2: return "avx2";
        case InstructionSet::scalar: break;
    }
    return "scalar";
}

}  // namespace recorder
