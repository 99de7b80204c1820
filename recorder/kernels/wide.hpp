// Sixteen 32-bit numbers in two vectors. Each operation is done on both before the next begins: a processor
// that looks a hundred instructions ahead then finds chains to work on at once, where one vector after
// another would leave it waiting. Four at a time would not fit sixteen registers.
#pragma once

#include <type_traits>

#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::uint32_t wide_parts = 2;
constexpr std::uint32_t wide_lanes = wide_parts * lanes32;

struct Wide {
    Lanes part[wide_parts];
};

RECORDER_INLINE Lanes part_of(const Wide &a, std::uint32_t i) { return a.part[i]; }
RECORDER_INLINE Lanes part_of(Lanes a, std::uint32_t) { return a; }

template <typename Operation, typename... Operands>
RECORDER_INLINE Wide on_parts(const Operation &operation, const Operands &...operands) {
    Wide result;
#pragma GCC unroll 2
    for (std::uint32_t i = 0; i < wide_parts; ++i) result.part[i] = operation(part_of(operands, i)...);
    return result;
}

// At least one operand is Wide; a vector beside it stands for two equal ones.
template <typename... Operands>
using IfWide = std::enable_if_t<(std::is_same_v<Operands, Wide> || ...), Wide>;

#define RECORDER_ON_WIDE(operation)                                                             \
    template <typename... Operands>                                                             \
    RECORDER_INLINE IfWide<Operands...> operation(const Operands &...operands) {                \
        return on_parts([](auto... parts) { return operation(parts...); }, operands...);        \
    }
RECORDER_ON_WIDE(add32)
RECORDER_ON_WIDE(sub32)
RECORDER_ON_WIDE(min32)
RECORDER_ON_WIDE(max32)
RECORDER_ON_WIDE(greater32)
RECORDER_ON_WIDE(left_by32)
RECORDER_ON_WIDE(right_by32)
RECORDER_ON_WIDE(choose32)
RECORDER_ON_WIDE(both)
RECORDER_ON_WIDE(common)
RECORDER_ON_WIDE(exponent32)
RECORDER_ON_WIDE(look_up)
#undef RECORDER_ON_WIDE

template <int N>
RECORDER_INLINE Wide left32(const Wide &a) {
    return on_parts([](Lanes part) { return left32<N>(part); }, a);
}
template <int N>
RECORDER_INLINE Wide right32(const Wide &a) {
    return on_parts([](Lanes part) { return right32<N>(part); }, a);
}
template <int N>
RECORDER_INLINE Wide signed_right32(const Wide &a) {
    return on_parts([](Lanes part) { return signed_right32<N>(part); }, a);
}

RECORDER_INLINE Wide load_wide(const std::uint32_t *p) {
    return {{load(p), load(p + lanes32)}};
}
RECORDER_INLINE void store_wide(std::uint32_t *p, const Wide &a) {
    for (std::uint32_t i = 0; i < wide_parts; ++i) store(p + i * lanes32, a.part[i]);
}

// All numbers one lane up, and `first` in the first lane.
RECORDER_INLINE Wide shifted_up32(Lanes first, const Wide &a) {
    return {{shifted_up32(first, a.part[0]), shifted_up32(a.part[0], a.part[1])}};
}

// 32 bits from each of base + offset, the first byte the highest. By scalar loads: the gather instruction is
// slow on AMD's processors, and on Intel's since its leaks were closed.
class BigEndianGather {
  public:
    explicit BigEndianGather(const std::uint8_t *base) : base_(base) {}

    struct Offsets {
        alignas(32) std::uint32_t at[wide_parts * lanes32];
    };
    // In two halves, because a number that was just stored takes time to be loaded.
    RECORDER_INLINE static void prepare(Offsets &offsets, const Wide &values) {
        store_wide(offsets.at, values);
        asm("" : "+m"(offsets));  // really stored, not taken to pieces in registers
    }
    RECORDER_INLINE Wide load(const Offsets &offsets) const {
        Wide words;
#pragma GCC unroll 2
        for (std::uint32_t i = 0; i < wide_parts; ++i) {
            const std::uint32_t *at = offsets.at + i * lanes32;
            words.part[i] = _mm256_inserti128_si256(_mm256_castsi128_si256(load4(at)), load4(at + 4), 1);
        }
        return look_up(words, reversed_);
    }

  private:
    RECORDER_INLINE int word(std::uint32_t offset) const {
        int value;
        std::memcpy(&value, base_ + offset, sizeof value);
        return value;
    }
    RECORDER_INLINE __m128i load4(const std::uint32_t *at) const {
        const __m128i low = _mm_insert_epi32(_mm_cvtsi32_si128(word(at[0])), word(at[1]), 1);
        const __m128i high = _mm_insert_epi32(_mm_cvtsi32_si128(word(at[2])), word(at[3]), 1);
        return _mm_unpacklo_epi64(low, high);
    }

    const std::uint8_t *base_;
    Lanes reversed_ = kept(_mm256_broadcastsi128_si256(
        _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12)));
};

}  // namespace recorder::RECORDER_VECTOR
