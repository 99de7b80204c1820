#include "cpu.hpp"

#include <cstdlib>
#include <cstring>

#include "error.hpp"

namespace recorder {
namespace {

constexpr InstructionSet all_sets[] = {InstructionSet::scalar, InstructionSet::avx2};

InstructionSet best() {
#if RECORDER_HAS_WIDE
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") &&
        __builtin_cpu_supports("lzcnt") && __builtin_cpu_supports("movbe"))
        return InstructionSet::avx2;
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
    throw ArgumentError{"RECORDER_KERNELS is scalar or avx2; unset, the best that the processor has"};
}

}  // namespace

InstructionSet instruction_set() {
    static const InstructionSet set = chosen();
    return set;
}

const char *name_of(InstructionSet set) { return set == InstructionSet::avx2 ? "avx2" : "scalar"; }

}  // namespace recorder
