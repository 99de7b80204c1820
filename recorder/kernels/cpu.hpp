// Instructions beyond the baseline, chosen when the process starts.
#pragma once

#if defined(__x86_64__)
#define RECORDER_HAS_WIDE 1
// A function compiled for every x86-64 since 2013 (Intel Haswell, AMD Excavator); call it only if has_wide().
#define RECORDER_WIDE __attribute__((target("avx2,bmi,bmi2,lzcnt")))
#else
#define RECORDER_HAS_WIDE 0
#define RECORDER_WIDE
#endif

namespace recorder {

// In the order of their power.
enum class InstructionSet { scalar, avx2, avx512 };

// What RECORDER_KERNELS in the environment names, or the best that the processor has. Throws ArgumentError if
// the name is unknown or the processor lacks it; once it has returned it always gives the same.
InstructionSet instruction_set();

// Its name, as in RECORDER_KERNELS.
const char *name_of(InstructionSet set);

// Whether RECORDER_WIDE functions and the kernels of the set avx2 may be called. Without them (other
// machines) it is false when compiled, and no call of theirs remains.
#if RECORDER_HAS_WIDE
inline bool has_wide() { return instruction_set() >= InstructionSet::avx2; }
#else
constexpr bool has_wide() { return false; }
#endif

}  // namespace recorder
