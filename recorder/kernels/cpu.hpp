// Instructions beyond the baseline, chosen when the process starts.
#pragma once

#include <cstdlib>

#if defined(__x86_64__)
#include <cpuid.h>
#define RECORDER_HAS_WIDE 1
// A function compiled for every x86-64 since 2013 (Intel Haswell, AMD Excavator); call it only if has_wide().
#define RECORDER_WIDE __attribute__((target("avx2,bmi,bmi2,lzcnt")))
#else
#define RECORDER_HAS_WIDE 0
#define RECORDER_WIDE
#endif

namespace recorder {

// Holds the process to the baseline, as RECORDER_PORTABLE_KERNELS in its environment does, while it is true: for
// tests that compare both.
inline bool baseline_only = std::getenv("RECORDER_PORTABLE_KERNELS") != nullptr;

// Whether RECORDER_WIDE functions and those of the *_avx2.cpp files may be called. Without them (other
// machines) it is false when compiled, and no call of theirs remains.
#if RECORDER_HAS_WIDE
inline bool has_wide() {
    // lzcnt and movbe by number: clang 14 does not know their names.
    static const bool has = [] {
        unsigned a, b, c, d, more;
        return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("bmi") != 0 &&
               __builtin_cpu_supports("bmi2") != 0 && __get_cpuid(1, &a, &b, &c, &d) != 0 && (c & bit_MOVBE) != 0 &&
               __get_cpuid(0x80000001, &a, &b, &more, &d) != 0 && (more & bit_LZCNT) != 0;
    }();
    return has && !baseline_only;
}
#else
constexpr bool has_wide() { return false; }
#endif

}  // namespace recorder
