// The code word of one pixel (docs/felics.md, "Code word"): Howard and Vitter 1993, bits reordered.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "bits.hpp"

namespace recorder {

constexpr std::uint32_t contexts = 17;         // floor(log2(n)) of n = 1 .. 65536
constexpr std::uint32_t escape_zeros = 9;      // so quotients 0 .. 7 are coded in unary
constexpr std::uint32_t escape_prefix = escape_zeros + 1;

using KTable = std::array<std::uint8_t, contexts>;
using WideKTable = std::array<std::uint32_t, contexts>;  // for the gathers of a vector unit

inline WideKTable widen(const KTable &table) {
    WideKTable wide{};
    for (std::uint32_t c = 0; c < contexts; ++c) wide[c] = table[c];
    return wide;
}

// Longest code word: the escape. No k exceeds the bit depth, so no Rice code is longer.
inline std::uint32_t longest_code(std::uint32_t depth) { return escape_prefix + depth; }

// The same if pixels may be above the depth, because another thread changes them after they were checked: the
// image is void then, but no code word is longer than this, whichever model.
inline std::uint32_t longest_code_of_any(std::uint32_t depth) { return std::max(longest_code(depth), contexts + 1u); }

// All ones where `value` is negative, else zero.
[[gnu::always_inline]] inline std::uint32_t negative_mask(std::uint32_t value) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(value) >> 31);
}

// Written with masks, because a compiler makes branches of conditional expressions, and a branch
// that depends on noise is mispredicted every other time (three times slower here).
[[gnu::always_inline]] inline std::uint32_t select(std::uint32_t mask, std::uint32_t yes, std::uint32_t no) {
    return no ^ ((yes ^ no) & mask);
}

// The neighbours' interval [low, high], its size, and what follows from it.
template <std::uint32_t (*Log2)(std::uint32_t)>
struct Interval {
    std::uint32_t low, high, size, context;
    std::uint32_t short_codes;  // of the truncated binary code: that many have one bit less

    [[gnu::always_inline]] Interval(std::uint32_t left, std::uint32_t top) {
        const std::uint32_t difference = left - top;
        const std::uint32_t lower = difference & negative_mask(difference);
        low = top + lower;
        high = left - lower;
        size = high - low + 1;
        context = Log2(size);
        short_codes = (2u << context) - size;
    }
};

struct Code {
    std::uint32_t value;
    std::uint32_t length;
};

// No branch depends on the data, so that a row of pixels can be computed side by side.
[[gnu::always_inline]] inline Code encode_pixel(std::uint32_t x, std::uint32_t left, std::uint32_t top, const std::uint32_t *table,
                         std::uint32_t depth) {
    const Interval<floor_log2_by_float> in(left, top);
    const std::uint32_t inside = x - in.low;
    const std::uint32_t is_long = negative_mask(in.short_codes - 1u - inside);

    const std::uint32_t is_above = negative_mask(in.high - x);
    const std::uint32_t is_outside = is_above | negative_mask(inside);
    const std::uint32_t distance = (select(is_above, x - in.high, in.low - x) - 1u) & is_outside;
    const std::uint32_t k = table[in.context];
    const std::uint32_t quotient = distance >> k;
    const std::uint32_t is_escape = negative_mask(escape_zeros - 2u - quotient);

    // Every code is zeros, a one, and `tail` in `tail_length` bits.
    const std::uint32_t tail = select(is_outside, ((distance - (quotient << k)) << 1) - is_above,
                                      inside + (in.short_codes & is_long));
    const std::uint32_t tail_length = select(is_outside, k + 1u, in.context - is_long);
    const std::uint32_t zeros = (quotient + 1u) & is_outside;
    const std::uint32_t length = select(is_escape, depth, tail_length);
    return {(1u << length) | select(is_escape, x, tail), length + 1u + select(is_escape, escape_zeros, zeros)};
}

struct Decoded {
    std::uint32_t value;
    std::uint32_t length;
    std::uint32_t wrong;  // not zero: no encoder writes this
};

// `bits` is left-aligned and holds at least longest_code(depth) valid bits.
[[gnu::always_inline]] inline Decoded decode_pixel(std::uint64_t bits, std::uint32_t left, std::uint32_t top,
                                                   const std::uint32_t *table, std::uint32_t depth) {
    // A sentinel ends the run of zeros at the escape's length, whatever follows.
    constexpr std::uint64_t sentinel = std::uint64_t{1} << (63u - escape_zeros);
    const std::uint32_t zeros = static_cast<std::uint32_t>(__builtin_clzll(bits | sentinel));
    if (__builtin_expect(zeros == escape_zeros, 0)) {
        const std::uint32_t raw = static_cast<std::uint32_t>((bits << escape_prefix) >> (64u - depth));
        return {raw, longest_code(depth), (bits & sentinel) == 0 ? 1u : 0u};
    }
    // Behind the zeros and the one: context + 1 bits inside (the last not its own if the code is short),
    // k + 1 bits outside.
    const Interval<floor_log2> in(left, top);
    const std::uint32_t is_inside = static_cast<std::uint32_t>(static_cast<std::int64_t>(bits) >> 63);
    const std::uint32_t k = table[in.context];
    const std::uint32_t tail_length = select(is_inside, in.context, k);
    const std::uint32_t tail = static_cast<std::uint32_t>((bits << (zeros + 1u)) >> (63u - tail_length));

    const std::uint32_t is_short = negative_mask((tail >> 1) - in.short_codes);
    const std::uint32_t in_value = in.low + select(is_short, tail >> 1, tail - in.short_codes);
    const std::uint32_t beyond = ((zeros - 1u) << k) + (tail >> 1) + 1u;
    const std::uint32_t out_value = select(0u - (tail & 1u), in.high + beyond, in.low - beyond);

    const std::uint32_t value = select(is_inside, in_value, out_value);
    return {value, zeros + 2u + tail_length + (is_short & is_inside), value >> depth};  // below zero wraps
}

}  // namespace recorder
