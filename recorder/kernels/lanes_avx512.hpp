// The vector operations that the kernels need, by the width of the numbers: 512 bits of AVX-512 F, BW, CD, DQ
// and VL, which every processor with AVX-512 for programs like this one has (Intel Skylake-SP, AMD Zen 4).
#pragma once

#include <immintrin.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

#define RECORDER_INLINE [[gnu::always_inline]] inline

namespace recorder::avx512 {

using Lanes = __m512i;

constexpr std::uint32_t lanes16 = 32;  // 16-bit numbers in one vector
constexpr std::uint32_t lanes32 = 16;

// One bit a number; where a vector is wanted, all ones or zero in each number.
struct Mask16 {
    __mmask32 bits;
    RECORDER_INLINE operator Lanes() const { return _mm512_movm_epi16(bits); }
};
struct Mask32 {
    __mmask16 bits;
    RECORDER_INLINE operator Lanes() const { return _mm512_movm_epi32(bits); }
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
RECORDER_INLINE Lanes choose32(Mask32 mask, Lanes yes, Lanes no) { return _mm512_mask_blend_epi32(mask.bits, no, yes); }
RECORDER_INLINE Lanes choose32(Lanes mask, Lanes yes, Lanes no) {
    return choose32(Mask32{_mm512_movepi32_mask(mask)}, yes, no);
}
RECORDER_INLINE bool any(Lanes a) { return _mm512_test_epi32_mask(a, a) != 0; }
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
// One bit a byte, the first byte's the lowest.
RECORDER_INLINE std::uint64_t equal_bits8(Lanes a, Lanes b) { return _mm512_cmpeq_epi8_mask(a, b); }
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
RECORDER_INLINE Lanes sub32(Lanes a, Lanes b) { return _mm512_sub_epi32(a, b); }
RECORDER_INLINE Lanes min32(Lanes a, Lanes b) { return _mm512_min_epu32(a, b); }
RECORDER_INLINE Lanes max32(Lanes a, Lanes b) { return _mm512_max_epu32(a, b); }
RECORDER_INLINE Mask32 greater32(Lanes a, Lanes b) { return {_mm512_cmpgt_epi32_mask(a, b)}; }  // signed
RECORDER_INLINE Lanes left_by32(Lanes a, Lanes count) { return _mm512_sllv_epi32(a, count); }
RECORDER_INLINE Lanes right_by32(Lanes a, Lanes count) { return _mm512_srlv_epi32(a, count); }
template <int N>
RECORDER_INLINE Lanes left32(Lanes a) {
    return _mm512_slli_epi32(a, N);
}
template <int N>
RECORDER_INLINE Lanes right32(Lanes a) {
    return _mm512_srli_epi32(a, N);
}
template <int N>
RECORDER_INLINE Lanes signed_right32(Lanes a) {
    return _mm512_srai_epi32(a, N);
}
// a0 b0 + a1 b1 of neighbouring 16-bit numbers.
RECORDER_INLINE Lanes dot_pairs16(Lanes a, Lanes b) { return _mm512_madd_epi16(a, b); }
// 127 + floor(log2(a)) of 1 <= a: as AVX2 reads it from the exponent of a float.
RECORDER_INLINE Lanes exponent32(Lanes a) { return sub32(all32(127 + 31), _mm512_lzcnt_epi32(a)); }

// Two vectors of 32-bit numbers below 2^16 in one of 16-bit numbers: four of a, four of b, and so on.
RECORDER_INLINE Lanes pack32(Lanes a, Lanes b) { return _mm512_packus_epi32(a, b); }
// What pack32 gave, in order.
RECORDER_INLINE Lanes in_order(Lanes packed) {
    return _mm512_permutexvar_epi64(_mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7), packed);
}
// The numbers of `a` one lane up, behind the last one of `before`.
RECORDER_INLINE Lanes shifted_up32(Lanes before, Lanes a) { return _mm512_alignr_epi32(a, before, 15); }
RECORDER_INLINE Lanes shifted_up16(Lanes before, Lanes a) {
    return _mm512_alignr_epi8(a, _mm512_alignr_epi64(a, before, 6), 14);
}
// The lower and the upper sixteen 16-bit numbers as 32-bit ones.
RECORDER_INLINE Lanes widened_low16(Lanes a) { return _mm512_cvtepu16_epi32(_mm512_castsi512_si256(a)); }
RECORDER_INLINE Lanes widened_high16(Lanes a) { return _mm512_cvtepu16_epi32(_mm512_extracti64x4_epi64(a, 1)); }
// Of each quarter (128 bits) of a and b the lower or upper numbers, in turns.
RECORDER_INLINE Lanes interleave_low16(Lanes a, Lanes b) { return _mm512_unpacklo_epi16(a, b); }
RECORDER_INLINE Lanes interleave_high16(Lanes a, Lanes b) { return _mm512_unpackhi_epi16(a, b); }
RECORDER_INLINE Lanes interleave_low32(Lanes a, Lanes b) { return _mm512_unpacklo_epi32(a, b); }
RECORDER_INLINE Lanes interleave_high32(Lanes a, Lanes b) { return _mm512_unpackhi_epi32(a, b); }
// Every 128 bits to a place of their own.
RECORDER_INLINE void store_blocks(void *const (&places)[4], Lanes a) {
    _mm_storeu_si128(static_cast<__m128i *>(places[0]), _mm512_castsi512_si128(a));
    _mm_storeu_si128(static_cast<__m128i *>(places[1]), _mm512_extracti32x4_epi32(a, 1));
    _mm_storeu_si128(static_cast<__m128i *>(places[2]), _mm512_extracti32x4_epi32(a, 2));
    _mm_storeu_si128(static_cast<__m128i *>(places[3]), _mm512_extracti32x4_epi32(a, 3));
}
// 32 bits from each of base + at[i]. By scalar loads: the gather instruction is slow on AMD's processors, and
// on Intel's since its leaks were closed.
RECORDER_INLINE Lanes load_each32(const std::uint8_t *base, const std::uint32_t *at) {
    const auto word = [&](std::uint32_t i) {
        int value;
        std::memcpy(&value, base + at[i], sizeof value);
        return value;
    };
    const auto four = [&](std::uint32_t i) {
        const __m128i low = _mm_insert_epi32(_mm_cvtsi32_si128(word(i)), word(i + 1), 1);
        const __m128i high = _mm_insert_epi32(_mm_cvtsi32_si128(word(i + 2)), word(i + 3), 1);
        return _mm_unpacklo_epi64(low, high);
    };
    const __m256i low = _mm256_inserti128_si256(_mm256_castsi128_si256(four(0)), four(4), 1);
    const __m256i high = _mm256_inserti128_si256(_mm256_castsi128_si256(four(8)), four(12), 1);
    return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
}

RECORDER_INLINE Lanes sub64(Lanes a, Lanes b) { return _mm512_sub_epi64(a, b); }
RECORDER_INLINE Lanes left_by64(Lanes a, Lanes count) { return _mm512_sllv_epi64(a, count); }
template <int N>
RECORDER_INLINE Lanes right64(Lanes a) {
    return _mm512_srli_epi64(a, N);
}
// Of every two 64-bit numbers of a and of b the first ones, or the second ones: a0 b0 a2 b2 ..., a1 b1 a3 b3 ...
RECORDER_INLINE Lanes firsts64(Lanes a, Lanes b) { return _mm512_unpacklo_epi64(a, b); }
RECORDER_INLINE Lanes seconds64(Lanes a, Lanes b) { return _mm512_unpackhi_epi64(a, b); }

}  // namespace recorder::avx512
