// Instructions beyond the baseline, chosen when the process starts.
#pragma once

#include <cstdlib>

#if defined(__x86_64__)
#define RECORDER_HAS_WIDE 1
// A function compiled for every x86-64 since 2013 (Intel Haswell, AMD Excavator); call it only if has_wide().
#define RECORDER_WIDE __attribute__((target("avx2,bmi,bmi2,lzcnt")))
#else
#define RECORDER_HAS_WIDE 0
#define RECORDER_WIDE
#endif

namespace recorder {

// Whether RECORDER_WIDE functions and those of the set avx2 may be called. Without them (other
// machines) it is false when compiled, and no call of theirs remains.
// RECORDER_PORTABLE_KERNELS in the environment holds a process to the baseline, for tests.
#if RECORDER_HAS_WIDE
inline bool has_wide() {
    static const bool has = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("bmi") != 0 &&
                            __builtin_cpu_supports("bmi2") != 0 && __builtin_cpu_supports("lzcnt") != 0 && __builtin_cpu_supports("movbe") != 0 &&
                            std::getenv("RECORDER_PORTABLE_KERNELS") == nullptr;
    return has;
}
#else
constexpr bool has_wide() { return false; }
#endif

}  // namespace recorder
