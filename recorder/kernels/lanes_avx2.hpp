// The vector operations that the kernels need, by the width of the numbers: 256 bits of AVX2.
#pragma once

#include <immintrin.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

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
// One bit a byte, the first byte's the lowest.
RECORDER_INLINE std::uint32_t equal_bits8(Lanes a, Lanes b) {
    return static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_cmpeq_epi8(a, b)));
}
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
// The exponent of a as a float, biased by 127: 127 + floor(log2(a)) of 1 <= a < 2^24.
RECORDER_INLINE Lanes exponent32(Lanes a) { return right32<23>(_mm256_castps_si256(_mm256_cvtepi32_ps(a))); }

// Two vectors of 32-bit numbers below 2^16 in one of 16-bit numbers: four of a, four of b, and so on.
RECORDER_INLINE Lanes pack32(Lanes a, Lanes b) { return _mm256_packus_epi32(a, b); }
// What pack32 gave, in order.
RECORDER_INLINE Lanes in_order(Lanes packed) { return _mm256_permute4x64_epi64(packed, 0xD8); }
// The numbers of `a` one lane up, behind the last one of `before`.
RECORDER_INLINE Lanes shifted_up32(Lanes before, Lanes a) {
    return _mm256_alignr_epi8(a, _mm256_permute2x128_si256(before, a, 0x21), 12);
}
RECORDER_INLINE Lanes shifted_up16(Lanes before, Lanes a) {
    return _mm256_alignr_epi8(a, _mm256_permute2x128_si256(before, a, 0x21), 14);
}
// The lower and the upper eight 16-bit numbers as 32-bit ones.
RECORDER_INLINE Lanes widened_low16(Lanes a) { return _mm256_cvtepu16_epi32(_mm256_castsi256_si128(a)); }
RECORDER_INLINE Lanes widened_high16(Lanes a) { return _mm256_cvtepu16_epi32(_mm256_extracti128_si256(a, 1)); }
// Of each half (128 bits) of a and b the lower or upper numbers, in turns.
RECORDER_INLINE Lanes interleave_low16(Lanes a, Lanes b) { return _mm256_unpacklo_epi16(a, b); }
RECORDER_INLINE Lanes interleave_high16(Lanes a, Lanes b) { return _mm256_unpackhi_epi16(a, b); }
RECORDER_INLINE Lanes interleave_low32(Lanes a, Lanes b) { return _mm256_unpacklo_epi32(a, b); }
RECORDER_INLINE Lanes interleave_high32(Lanes a, Lanes b) { return _mm256_unpackhi_epi32(a, b); }
// Every 128 bits to a place of their own.
RECORDER_INLINE void store_blocks(void *const (&places)[2], Lanes a) {
    _mm_storeu_si128(static_cast<__m128i *>(places[0]), _mm256_castsi256_si128(a));
    _mm_storeu_si128(static_cast<__m128i *>(places[1]), _mm256_extracti128_si256(a, 1));
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
    return _mm256_inserti128_si256(_mm256_castsi128_si256(four(0)), four(4), 1);
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

}  // namespace recorder::avx2
