// The vector operations that the kernels need, by the width of the numbers: 512 bits of AVX-512 F, BW, CD, DQ
// and VL, which every processor with AVX-512 for programs like this one has (Intel Skylake-SP, AMD Zen 4).
#pragma once

#include <immintrin.h>

#include <cstddef>
#include <cstdint>

#define RECORDER_INLINE [[gnu::always_inline]] inline

namespace recorder::avx512 {

using Lanes = __m512i;

constexpr std::uint32_t lanes16 = 32;  // 16-bit numbers in one vector

// One bit a number.
struct Mask8 {
    __mmask64 bits;
};
struct Mask16 {
    __mmask32 bits;
    // Where a vector is wanted: all ones or zero in each number.
    RECORDER_INLINE operator Lanes() const { return _mm512_movm_epi16(bits); }
};
struct Mask32 {
    __mmask16 bits;
};

// A constant that the compiler keeps: with 32 registers it does so unasked.
RECORDER_INLINE Lanes kept(Lanes a) { return a; }

RECORDER_INLINE Lanes zero() { return _mm512_setzero_si512(); }
RECORDER_INLINE Lanes all16(std::uint32_t x) { return _mm512_set1_epi16(static_cast<short>(x)); }
RECORDER_INLINE Lanes all32(std::uint32_t x) { return _mm512_set1_epi32(static_cast<int>(x)); }
RECORDER_INLINE Lanes all64(std::uint64_t x) { return _mm512_set1_epi64(static_cast<long long>(x)); }

// The first 16-bit number.
RECORDER_INLINE Mask16 first_lane16() { return {1}; }

RECORDER_INLINE Lanes load(const void *p) { return _mm512_loadu_si512(p); }
RECORDER_INLINE void store(void *p, Lanes a) { _mm512_storeu_si512(p, a); }
RECORDER_INLINE void prefetch(const void *p) { _mm_prefetch(static_cast<const char *>(p), _MM_HINT_T0); }

RECORDER_INLINE Lanes both(Lanes a, Lanes b) { return _mm512_or_si512(a, b); }
RECORDER_INLINE Lanes common(Lanes a, Lanes b) { return _mm512_and_si512(a, b); }
RECORDER_INLINE Lanes differing(Lanes a, Lanes b) { return _mm512_xor_si512(a, b); }
// b where a has no bits.
RECORDER_INLINE Lanes and_not(Lanes a, Lanes b) { return _mm512_andnot_si512(a, b); }
RECORDER_INLINE Lanes choose(Mask16 mask, Lanes yes, Lanes no) { return _mm512_mask_blend_epi16(mask.bits, no, yes); }
// By the highest bit of every number of `mask`.
RECORDER_INLINE Lanes choose(Lanes mask, Lanes yes, Lanes no) {
    return choose(Mask16{_mm512_movepi16_mask(mask)}, yes, no);
}
RECORDER_INLINE bool any(Mask8 a) { return a.bits != 0; }
RECORDER_INLINE bool any(Mask32 a) { return a.bits != 0; }

RECORDER_INLINE Lanes add16(Lanes a, Lanes b) { return _mm512_add_epi16(a, b); }
RECORDER_INLINE Lanes sub16(Lanes a, Lanes b) { return _mm512_sub_epi16(a, b); }
RECORDER_INLINE Lanes min16(Lanes a, Lanes b) { return _mm512_min_epu16(a, b); }
RECORDER_INLINE Lanes max16(Lanes a, Lanes b) { return _mm512_max_epu16(a, b); }
RECORDER_INLINE Lanes signed_min16(Lanes a, Lanes b) { return _mm512_min_epi16(a, b); }
RECORDER_INLINE Lanes signed_max16(Lanes a, Lanes b) { return _mm512_max_epi16(a, b); }
// a - b, or zero where that is negative.
RECORDER_INLINE Lanes monus16(Lanes a, Lanes b) { return _mm512_subs_epu16(a, b); }
RECORDER_INLINE Lanes abs16(Lanes a) { return _mm512_abs_epi16(a); }
RECORDER_INLINE Lanes average16(Lanes a, Lanes b) { return _mm512_avg_epu16(a, b); }
// (a b + 2^14) >> 15, signed.
RECORDER_INLINE Lanes multiply_round16(Lanes a, Lanes b) { return _mm512_mulhrs_epi16(a, b); }
RECORDER_INLINE Mask16 equal16(Lanes a, Lanes b) { return {_mm512_cmpeq_epi16_mask(a, b)}; }
RECORDER_INLINE Mask16 greater16(Lanes a, Lanes b) { return {_mm512_cmpgt_epi16_mask(a, b)}; }  // signed
template <int N>
RECORDER_INLINE Lanes left16(Lanes a) {
    return _mm512_slli_epi16(a, N);
}
template <int N>
RECORDER_INLINE Lanes right16(Lanes a) {
    return _mm512_srli_epi16(a, N);
}

RECORDER_INLINE Lanes all8(std::uint32_t x) { return _mm512_set1_epi8(static_cast<char>(x)); }
RECORDER_INLINE Mask8 equal8(Lanes a, Lanes b) { return {_mm512_cmpeq_epi8_mask(a, b)}; }
RECORDER_INLINE Mask8 both(Mask8 a, Mask8 b) { return {a.bits | b.bits}; }
RECORDER_INLINE Mask8 common(Mask8 a, Mask8 b) { return {a.bits & b.bits}; }
// The bit of every byte, the first byte's the lowest.
RECORDER_INLINE std::uint64_t high_bits8(Mask8 a) { return a.bits; }
RECORDER_INLINE std::uint32_t lowest_bit(std::uint64_t a) { return static_cast<std::uint32_t>(_tzcnt_u64(a)); }
// By one count for all.
RECORDER_INLINE Lanes left16_by(Lanes a, std::uint32_t count) {
    return _mm512_sll_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes right16_by(Lanes a, std::uint32_t count) {
    return _mm512_srl_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes signed_right16_by(Lanes a, std::uint32_t count) {
    return _mm512_sra_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes saturating_add16(Lanes a, Lanes b) { return _mm512_adds_epi16(a, b); }  // signed

// A table of 16 bytes, looked up by the low four bits of every byte of `index`; zero where its bit 7 is set.
RECORDER_INLINE Lanes table16(const void *bytes) {
    return _mm512_broadcast_i32x4(_mm_loadu_si128(static_cast<const __m128i *>(bytes)));
}
RECORDER_INLINE Lanes look_up(Lanes table, Lanes index) { return _mm512_shuffle_epi8(table, index); }

RECORDER_INLINE Lanes add32(Lanes a, Lanes b) { return _mm512_add_epi32(a, b); }
RECORDER_INLINE Lanes max32(Lanes a, Lanes b) { return _mm512_max_epu32(a, b); }
RECORDER_INLINE Mask32 greater32(Lanes a, Lanes b) { return {_mm512_cmpgt_epi32_mask(a, b)}; }  // signed
RECORDER_INLINE Lanes left_by32(Lanes a, Lanes count) { return _mm512_sllv_epi32(a, count); }
template <int N>
RECORDER_INLINE Lanes left32(Lanes a) {
    return _mm512_slli_epi32(a, N);
}
template <int N>
RECORDER_INLINE Lanes right32(Lanes a) {
    return _mm512_srli_epi32(a, N);
}
// a0 b0 + a1 b1 of neighbouring 16-bit numbers.
RECORDER_INLINE Lanes dot_pairs16(Lanes a, Lanes b) { return _mm512_madd_epi16(a, b); }

RECORDER_INLINE Lanes sub64(Lanes a, Lanes b) { return _mm512_sub_epi64(a, b); }
RECORDER_INLINE Lanes left_by64(Lanes a, Lanes count) { return _mm512_sllv_epi64(a, count); }
template <int N>
RECORDER_INLINE Lanes right64(Lanes a) {
    return _mm512_srli_epi64(a, N);
}

}  // namespace recorder::avx512
