// The vector operations that the kernels need, by the width of the numbers: 256 bits of AVX2.
#pragma once

#include <immintrin.h>

#include <cstddef>
#include <cstdint>

#define RECORDER_INLINE [[gnu::always_inline]] inline

namespace recorder::avx2 {

using Lanes = __m256i;

constexpr std::uint32_t lanes16 = 16;  // 16-bit numbers in one vector
constexpr std::uint32_t lanes32 = 8;

// A constant that the compiler keeps, where it would build it anew at every use.
RECORDER_INLINE Lanes kept(Lanes a) {
    asm("" : "+x"(a));
    return a;
}

RECORDER_INLINE Lanes zero() { return _mm256_setzero_si256(); }
RECORDER_INLINE Lanes all16(std::uint32_t x) { return _mm256_set1_epi16(static_cast<short>(x)); }
RECORDER_INLINE Lanes all32(std::uint32_t x) { return _mm256_set1_epi32(static_cast<int>(x)); }
RECORDER_INLINE Lanes all64(std::uint64_t x) { return _mm256_set1_epi64x(static_cast<long long>(x)); }

// All ones in the first 16-bit number.
RECORDER_INLINE Lanes first_lane16() { return _mm256_setr_epi32(0xFFFF, 0, 0, 0, 0, 0, 0, 0); }

RECORDER_INLINE Lanes load(const void *p) { return _mm256_loadu_si256(static_cast<const Lanes *>(p)); }
RECORDER_INLINE void store(void *p, Lanes a) { _mm256_storeu_si256(static_cast<Lanes *>(p), a); }
RECORDER_INLINE void prefetch(const void *p) { _mm_prefetch(static_cast<const char *>(p), _MM_HINT_T0); }

RECORDER_INLINE Lanes both(Lanes a, Lanes b) { return _mm256_or_si256(a, b); }
RECORDER_INLINE Lanes common(Lanes a, Lanes b) { return _mm256_and_si256(a, b); }
RECORDER_INLINE Lanes differing(Lanes a, Lanes b) { return _mm256_xor_si256(a, b); }
// b where a has no bits.
RECORDER_INLINE Lanes and_not(Lanes a, Lanes b) { return _mm256_andnot_si256(a, b); }
// By the highest bit of every byte of `mask`. (As an instruction of its own: GCC 12 puts a comparison before
// the intrinsic's.)
RECORDER_INLINE Lanes choose(Lanes mask, Lanes yes, Lanes no) {
    Lanes chosen;
    asm("vpblendvb %3, %2, %1, %0" : "=x"(chosen) : "x"(no), "x"(yes), "x"(mask));
    return chosen;
}
// By the highest bit of every 32-bit number of `mask`.
RECORDER_INLINE Lanes choose32(Lanes mask, Lanes yes, Lanes no) {
    Lanes chosen;
    asm("vblendvps %3, %2, %1, %0" : "=x"(chosen) : "x"(no), "x"(yes), "x"(mask));
    return chosen;
}
RECORDER_INLINE bool any(Lanes a) { return _mm256_testz_si256(a, a) == 0; }

RECORDER_INLINE Lanes add16(Lanes a, Lanes b) { return _mm256_add_epi16(a, b); }
RECORDER_INLINE Lanes sub16(Lanes a, Lanes b) { return _mm256_sub_epi16(a, b); }
RECORDER_INLINE Lanes min16(Lanes a, Lanes b) { return _mm256_min_epu16(a, b); }
RECORDER_INLINE Lanes max16(Lanes a, Lanes b) { return _mm256_max_epu16(a, b); }
RECORDER_INLINE Lanes signed_min16(Lanes a, Lanes b) { return _mm256_min_epi16(a, b); }
RECORDER_INLINE Lanes signed_max16(Lanes a, Lanes b) { return _mm256_max_epi16(a, b); }
// a - b, or zero where that is negative.
RECORDER_INLINE Lanes monus16(Lanes a, Lanes b) { return _mm256_subs_epu16(a, b); }
RECORDER_INLINE Lanes abs16(Lanes a) { return _mm256_abs_epi16(a); }
RECORDER_INLINE Lanes average16(Lanes a, Lanes b) { return _mm256_avg_epu16(a, b); }
RECORDER_INLINE Lanes multiply16(Lanes a, Lanes b) { return _mm256_mullo_epi16(a, b); }
RECORDER_INLINE Lanes multiply_high16(Lanes a, Lanes b) { return _mm256_mulhi_epu16(a, b); }
// (a b + 2^14) >> 15, signed.
RECORDER_INLINE Lanes multiply_round16(Lanes a, Lanes b) { return _mm256_mulhrs_epi16(a, b); }
RECORDER_INLINE Lanes equal16(Lanes a, Lanes b) { return _mm256_cmpeq_epi16(a, b); }
RECORDER_INLINE Lanes greater16(Lanes a, Lanes b) { return _mm256_cmpgt_epi16(a, b); }  // signed
template <int N>
RECORDER_INLINE Lanes left16(Lanes a) {
    return _mm256_slli_epi16(a, N);
}
template <int N>
RECORDER_INLINE Lanes right16(Lanes a) {
    return _mm256_srli_epi16(a, N);
}

RECORDER_INLINE Lanes all8(std::uint32_t x) { return _mm256_set1_epi8(static_cast<char>(x)); }
RECORDER_INLINE Lanes equal8(Lanes a, Lanes b) { return _mm256_cmpeq_epi8(a, b); }
// The highest bit of every byte, the first byte's the lowest.
RECORDER_INLINE std::uint32_t high_bits8(Lanes a) { return static_cast<std::uint32_t>(_mm256_movemask_epi8(a)); }
RECORDER_INLINE std::uint32_t lowest_bit(std::uint32_t a) { return _tzcnt_u32(a); }
// By one count for all.
RECORDER_INLINE Lanes left16_by(Lanes a, std::uint32_t count) {
    return _mm256_sll_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes right16_by(Lanes a, std::uint32_t count) {
    return _mm256_srl_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes signed_right16_by(Lanes a, std::uint32_t count) {
    return _mm256_sra_epi16(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
RECORDER_INLINE Lanes saturating_add16(Lanes a, Lanes b) { return _mm256_adds_epi16(a, b); }  // signed

RECORDER_INLINE Lanes signed_max8(Lanes a, Lanes b) { return _mm256_max_epi8(a, b); }
RECORDER_INLINE Lanes signed_add8(Lanes a, Lanes b) { return _mm256_adds_epi8(a, b); }  // saturating

// A table of 16 bytes, looked up by the low four bits of every byte of `index`; zero where its bit 7 is set.
RECORDER_INLINE Lanes table16(const void *bytes) {
    return _mm256_broadcastsi128_si256(_mm_loadu_si128(static_cast<const __m128i *>(bytes)));
}
RECORDER_INLINE Lanes look_up(Lanes table, Lanes index) { return _mm256_shuffle_epi8(table, index); }

RECORDER_INLINE Lanes add32(Lanes a, Lanes b) { return _mm256_add_epi32(a, b); }
RECORDER_INLINE Lanes sub32(Lanes a, Lanes b) { return _mm256_sub_epi32(a, b); }
RECORDER_INLINE Lanes min32(Lanes a, Lanes b) { return _mm256_min_epu32(a, b); }
RECORDER_INLINE Lanes max32(Lanes a, Lanes b) { return _mm256_max_epu32(a, b); }
RECORDER_INLINE Lanes greater32(Lanes a, Lanes b) { return _mm256_cmpgt_epi32(a, b); }  // signed
RECORDER_INLINE Lanes left_by32(Lanes a, Lanes count) { return _mm256_sllv_epi32(a, count); }
RECORDER_INLINE Lanes right_by32(Lanes a, Lanes count) { return _mm256_srlv_epi32(a, count); }
template <int N>
RECORDER_INLINE Lanes left32(Lanes a) {
    return _mm256_slli_epi32(a, N);
}
template <int N>
RECORDER_INLINE Lanes right32(Lanes a) {
    return _mm256_srli_epi32(a, N);
}
template <int N>
RECORDER_INLINE Lanes signed_right32(Lanes a) {
    return _mm256_srai_epi32(a, N);
}
// a0 b0 + a1 b1 of neighbouring 16-bit numbers.
RECORDER_INLINE Lanes dot_pairs16(Lanes a, Lanes b) { return _mm256_madd_epi16(a, b); }
// By one count for all.
RECORDER_INLINE Lanes right32_by(Lanes a, std::uint32_t count) {
    return _mm256_srl_epi32(a, _mm_cvtsi32_si128(static_cast<int>(count)));
}
// Sign and exponent of a as a float: 127 + floor(log2(a)) of a > 0 with at most 24 significant bits, 0 of
// zero, 256 and more of negative numbers.
RECORDER_INLINE Lanes exponent32(Lanes a) { return right32<23>(_mm256_castps_si256(_mm256_cvtepi32_ps(a))); }
// Of each half of a and b the even or the odd 32-bit numbers: a0 a2 b0 b2, a1 a3 b1 b3.
RECORDER_INLINE Lanes evens32(Lanes a, Lanes b) {
    return _mm256_castps_si256(_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), 0x88));
}
RECORDER_INLINE Lanes odds32(Lanes a, Lanes b) {
    return _mm256_castps_si256(_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), 0xDD));
}
// Four 64-bit words, wherever they stand, two in each half.
RECORDER_INLINE Lanes load_each64(const void *a, const void *b, const void *c, const void *d) {
    const auto two = [](const void *first, const void *second) {
        const __m128i low = _mm_loadl_epi64(static_cast<const __m128i *>(first));
        // Only doubles have a load into the upper half; the instruction asks for no alignment.
        return _mm_castpd_si128(_mm_loadh_pd(_mm_castsi128_pd(low), static_cast<const double *>(second)));
    };
    return _mm256_inserti128_si256(_mm256_castsi128_si256(two(a, b)), two(c, d), 1);
}

// Two vectors of 32-bit numbers below 2^16 in one of 16-bit numbers: 0-3 of a, of b, 4-7 of a, of b. Undoes
// interleave_low16 and interleave_high16 with zero.
RECORDER_INLINE Lanes pack32(Lanes a, Lanes b) { return _mm256_packus_epi32(a, b); }
// Of each half (128 bits) the numbers one lane down, and behind them the first one of that half of `next`.
RECORDER_INLINE Lanes shifted_down16(Lanes a, Lanes next) { return _mm256_alignr_epi8(next, a, 2); }
// Sixteen bytes from p, then the lower half of a.
RECORDER_INLINE Lanes before_low_half(const void *p, Lanes a) {
    return _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128(static_cast<const __m128i *>(p))),
                                   _mm256_castsi256_si128(a), 1);
}
// Of each half (128 bits) of a and b the lower or upper numbers, in turns.
RECORDER_INLINE Lanes interleave_low16(Lanes a, Lanes b) { return _mm256_unpacklo_epi16(a, b); }
RECORDER_INLINE Lanes interleave_high16(Lanes a, Lanes b) { return _mm256_unpackhi_epi16(a, b); }
RECORDER_INLINE Lanes interleave_low32(Lanes a, Lanes b) { return _mm256_unpacklo_epi32(a, b); }
RECORDER_INLINE Lanes interleave_high32(Lanes a, Lanes b) { return _mm256_unpackhi_epi32(a, b); }
// Either half.
RECORDER_INLINE void store_low(void *p, Lanes a) {
    _mm_storeu_si128(static_cast<__m128i *>(p), _mm256_castsi256_si128(a));
}
RECORDER_INLINE void store_high(void *p, Lanes a) {
    _mm_storeu_si128(static_cast<__m128i *>(p), _mm256_extracti128_si256(a, 1));
}

RECORDER_INLINE Lanes sub64(Lanes a, Lanes b) { return _mm256_sub_epi64(a, b); }
RECORDER_INLINE Lanes left_by64(Lanes a, Lanes count) { return _mm256_sllv_epi64(a, count); }
template <int N>
RECORDER_INLINE Lanes right64(Lanes a) {
    return _mm256_srli_epi64(a, N);
}
// Of every two 64-bit numbers of a and of b the first ones, or the second ones: a0 b0 a2 b2, a1 b1 a3 b3.
RECORDER_INLINE Lanes firsts64(Lanes a, Lanes b) { return _mm256_unpacklo_epi64(a, b); }
RECORDER_INLINE Lanes seconds64(Lanes a, Lanes b) { return _mm256_unpackhi_epi64(a, b); }
// a0 a2 a1 a3.
RECORDER_INLINE Lanes middle_swapped64(Lanes a) { return _mm256_permute4x64_epi64(a, 0xD8); }

}  // namespace recorder::avx2
