// Stands for the compiler's header where the AVX-512 kernels are checked on a processor without AVX-512:
// SIMDe does what their intrinsics would do, and the few that its version 0.7.4 lacks are here.
#pragma once

#include_next <immintrin.h>

#define SIMDE_ENABLE_NATIVE_ALIASES
#include <simde/x86/avx512.h>

#include <cstdint>

namespace emulated {

template <typename Number>
struct Numbers {
    static constexpr int count = 64 / sizeof(Number);
    Number of[count];
};
template <typename Number>
inline Numbers<Number> numbers(__m512i a) {
    Numbers<Number> result;
    __builtin_memcpy(&result, &a, sizeof a);
    return result;
}
template <typename Number>
inline __m512i vector(const Numbers<Number> &a) {
    __m512i result;
    __builtin_memcpy(&result, &a, sizeof a);
    return result;
}

template <typename Relation>
inline __mmask32 compare16(__m512i a, __m512i b, const Relation &holds) {
    const auto x = numbers<std::int16_t>(a), y = numbers<std::int16_t>(b);
    __mmask32 mask = 0;
    for (int i = 0; i < x.count; ++i) mask |= __mmask32{holds(x.of[i], y.of[i])} << i;
    return mask;
}
inline __mmask32 equal16(__m512i a, __m512i b) {
    return compare16(a, b, [](int x, int y) { return x == y; });
}
inline __mmask32 greater16(__m512i a, __m512i b) {
    return compare16(a, b, [](int x, int y) { return x > y; });
}

inline __m512i leading_zeros32(__m512i a) {
    auto x = numbers<std::uint32_t>(a);
    for (auto &number : x.of) number = number == 0 ? 32u : static_cast<std::uint32_t>(__builtin_clz(number));
    return vector(x);
}

}  // namespace emulated

#undef _mm512_madd_epi16  // in this version with the arguments of the masked one
#define _mm512_madd_epi16 simde_mm512_madd_epi16

#define _mm512_cmpeq_epi16_mask emulated::equal16
#define _mm512_cmpgt_epi16_mask emulated::greater16
#define _mm512_lzcnt_epi32 emulated::leading_zeros32
