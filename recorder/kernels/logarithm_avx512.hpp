// Powers of two and their logarithms in 16-bit lanes. "Twice" is a number that stands in both bytes of its lane.
#pragma once

#include "lanes_avx512.hpp"

namespace recorder::avx512 {

class Powers {
  public:
    // floor(log2(n)) of n >= 1, twice.
    RECORDER_INLINE Lanes log2_twice(Lanes n) const {
        const Lanes even_zeros = _mm512_lzcnt_epi32(common(n, low16_)), odd_zeros = _mm512_lzcnt_epi32(n);
        const Lanes logarithm = sub16(highest_, both(left32<16>(odd_zeros), even_zeros));
        return look_up(logarithm, low_byte_twice_);
    }

    // 2^n of 0 <= n < 16 given twice.
    RECORDER_INLINE Lanes power(Lanes n_twice) const { return _mm512_sllv_epi16(one_, common(n_twice, low_byte_)); }

    // a / 2^n, rounded down, of n < 16 given twice.
    RECORDER_INLINE Lanes divided(Lanes a, Lanes n_twice) const {
        return _mm512_srlv_epi16(a, common(n_twice, low_byte_));
    }

  private:
    alignas(16) static constexpr unsigned char low_bytes[16] = {0, 0, 2, 2, 4, 4, 6, 6, 8, 8, 10, 10, 12, 12, 14, 14};

    Lanes low16_ = all32(0xFFFF), highest_ = all32(0x000F001F), low_byte_twice_ = table16(low_bytes);
    Lanes one_ = all16(1), low_byte_ = all16(0xFF);
};

}  // namespace recorder::avx512
