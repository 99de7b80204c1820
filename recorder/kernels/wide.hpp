// As many 32-bit numbers as one vector has 16-bit ones, in two vectors. Each operation is done on both before
// the next begins: a processor that looks a hundred instructions ahead then finds chains to work on at once,
// where one vector after another would leave it waiting.
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
RECORDER_ON_WIDE(left_by32)
RECORDER_ON_WIDE(right_by32)
RECORDER_ON_WIDE(both)
RECORDER_ON_WIDE(common)
RECORDER_ON_WIDE(exponent32)
#undef RECORDER_ON_WIDE

template <int N>
RECORDER_INLINE Wide right32(const Wide &a) {
    return on_parts([](Lanes part) { return right32<N>(part); }, a);
}
RECORDER_INLINE Wide right32_by(const Wide &a, std::uint32_t count) {
    return on_parts([count](Lanes part) { return right32_by(part, count); }, a);
}

RECORDER_INLINE Wide load_wide(const std::uint32_t *p) {
    return {{load(p), load(p + lanes32)}};
}
RECORDER_INLINE void store_wide(std::uint32_t *p, const Wide &a) {
    for (std::uint32_t i = 0; i < wide_parts; ++i) store(p + i * lanes32, a.part[i]);
}

// One vector of 16-bit numbers as 32-bit ones, and back. Of each half of the vector the first part has the
// lower numbers.
RECORDER_INLINE Wide widened(Lanes a) { return {{interleave_low16(a, zero()), interleave_high16(a, zero())}}; }
RECORDER_INLINE Lanes narrowed(const Wide &a) { return pack32(a.part[0], a.part[1]); }

// Sixty-four bits, the first ones highest.
struct Words {
    Wide first, second;
};

// Such words from base + offset, for each of many offsets. By scalar loads: the gather instruction is slow on
// AMD's processors, and on Intel's since its leaks were closed.
class BigEndianGather {
  public:
    explicit BigEndianGather(const std::uint8_t *base) : base_(base) {}

    struct Offsets {
        alignas(32) std::uint32_t at[wide_lanes];
    };
    // In two halves, because a number that was just stored takes time to be loaded.
    RECORDER_INLINE static void prepare(Offsets &offsets, const Wide &values) {
        store_wide(offsets.at, values);
        asm("" : "+m"(offsets));  // really stored, not taken to pieces in registers
    }
    RECORDER_INLINE Words load(const Offsets &offsets) const {
        Words words;
#pragma GCC unroll 2
        for (std::uint32_t i = 0; i < wide_parts; ++i) {
            const std::uint32_t *at = offsets.at + i * lanes32;
            const Lanes some = load_each64(base_ + at[0], base_ + at[1], base_ + at[4], base_ + at[5]);
            const Lanes others = load_each64(base_ + at[2], base_ + at[3], base_ + at[6], base_ + at[7]);
            words.first.part[i] = look_up(evens32(some, others), reversed_);
            words.second.part[i] = look_up(odds32(some, others), reversed_);
        }
        return words;
    }

  private:
    alignas(16) static constexpr std::uint8_t reversed_bytes[16] = {3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12};

    const std::uint8_t *base_;
    Lanes reversed_ = kept(table16(reversed_bytes));
};

}  // namespace recorder::RECORDER_VECTOR
