// Powers of two and their logarithms in 16-bit lanes, by table: AVX2 has neither shifts by a vector nor a
// count of leading zeros for them. "Twice" is a number that stands in both bytes of its lane.
#pragma once

#include "lanes_avx2.hpp"

namespace recorder::avx2 {

class Powers {
  public:
    // floor(log2(n)) of n >= 1, twice.
    RECORDER_INLINE Lanes log2_twice(Lanes n) const {
        const Lanes low = look_up(low_nibble_, common(n, nibble_)), high = look_up(high_nibble_, common(right16<4>(n), nibble_));
        // Of each byte on its own, negative where it is zero; eight more in the upper one.
        const Lanes of_byte = signed_add8(signed_max8(low, high), eight_above_);
        return signed_max8(of_byte, look_up(of_byte, other_byte_));
    }

    // 2^n of 0 <= n < 16 given twice.
    RECORDER_INLINE Lanes power(Lanes n_twice) const { return look_up(powers_, sub16(n_twice, eight_above_)); }

    // a / 2^n, rounded down, of a < 2^15 and n < 16 given twice.
    RECORDER_INLINE Lanes divided(Lanes a, Lanes n_twice) const {
        return multiply_high16(add16(a, a), power(sub16(fifteen_twice_, n_twice)));
    }

  private:
    alignas(16) static constexpr signed char low_bytes[16] = {-128, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3};
    alignas(16) static constexpr signed char high_bytes[16] = {-128, 4, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7, 7, 7, 7, 7};
    alignas(16) static constexpr unsigned char power_bytes[16] = {1, 2, 4, 8, 16, 32, 64, 128};
    alignas(16) static constexpr signed char swap_bytes[16] = {1, 0, 3,  2, 5,  4,  7,  6,
                                                               9, 8, 11, 10, 13, 12, 15, 14};

    Lanes low_nibble_ = kept(table16(low_bytes)), high_nibble_ = kept(table16(high_bytes));
    Lanes powers_ = kept(table16(power_bytes)), other_byte_ = kept(table16(swap_bytes));
    Lanes nibble_ = kept(all16(0x0F0F)), eight_above_ = kept(all16(0x0800));
    Lanes fifteen_twice_ = kept(all16(0x0F0F));
};

}  // namespace recorder::avx2
