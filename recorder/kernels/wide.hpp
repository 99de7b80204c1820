// Sixteen 32-bit numbers, in one vector or two. Each operation is done on both before the next begins: a
// processor that looks a hundred instructions ahead then finds chains to work on at once, where one vector
// after another would leave it waiting. Four at a time would not fit sixteen registers.
#pragma once

#include <type_traits>

#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::uint32_t wide_lanes = 16;
constexpr std::uint32_t wide_parts = wide_lanes / lanes32;

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
    Wide a;
    for (std::uint32_t i = 0; i < wide_parts; ++i) a.part[i] = load(p + i * lanes32);
    return a;
}
RECORDER_INLINE void store_wide(std::uint32_t *p, const Wide &a) {
    for (std::uint32_t i = 0; i < wide_parts; ++i) store(p + i * lanes32, a.part[i]);
}

// All numbers one lane up, and `first` in the first lane.
RECORDER_INLINE Wide shifted_up32(Lanes first, const Wide &a) {
    Wide shifted;
    for (std::uint32_t i = 0; i < wide_parts; ++i)
        shifted.part[i] = shifted_up32(i > 0 ? a.part[i - 1] : first, a.part[i]);
    return shifted;
}

// Thirty-two numbers below 2^16 packed, vector after vector, each as pack32 leaves it.
RECORDER_INLINE void pack(const Wide (&a)[2], Lanes (&packed)[wide_parts]) {
    for (std::uint32_t i = 0; i < wide_parts; ++i) {
        const std::uint32_t j = 2 * i, k = j + 1;
        packed[i] = pack32(a[j / wide_parts].part[j % wide_parts], a[k / wide_parts].part[k % wide_parts]);
    }
}

// 32 bits from each of base + offset, the first byte the highest.
class BigEndianGather {
  public:
    explicit BigEndianGather(const std::uint8_t *base) : base_(base) {}

    struct Offsets {
        alignas(sizeof(Lanes)) std::uint32_t at[wide_lanes];
    };
    // In two halves, because a number that was just stored takes time to be loaded.
    RECORDER_INLINE static void prepare(Offsets &offsets, const Wide &values) {
        store_wide(offsets.at, values);
        asm("" : "+m"(offsets));  // really stored, not taken to pieces in registers
    }
    RECORDER_INLINE Wide load(const Offsets &offsets) const {
        Wide words;
#pragma GCC unroll 2
        for (std::uint32_t i = 0; i < wide_parts; ++i) words.part[i] = load_each32(base_, offsets.at + i * lanes32);
        return look_up(words, reversed_);
    }

  private:
    alignas(16) static constexpr std::uint8_t reversed_words[16] = {3,  2,  1, 0, 7,  6,  5,  4,
                                                                    11, 10, 9, 8, 15, 14, 13, 12};

    const std::uint8_t *base_;
    Lanes reversed_ = kept(table16(reversed_words));
};

}  // namespace recorder::RECORDER_VECTOR
