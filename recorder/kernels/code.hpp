// The code word of one pixel (docs/felics.md, "Code word"): Howard and Vitter 1993, bits reordered.
#pragma once

#include <array>
#include <cstdint>

#include "bits.hpp"

namespace recorder {

constexpr std::uint32_t contexts = 17;         // floor(log2(n)) of n = 1 .. 65536
constexpr std::uint32_t escape_zeros = 9;      // so quotients 0 .. 7 are coded in unary
constexpr std::uint32_t escape_prefix = escape_zeros + 1;

using KTable = std::array<std::uint8_t, contexts>;

// Longest code word: the escape. No k exceeds the bit depth, so no Rice code is longer.
inline std::uint32_t longest_code(std::uint32_t depth) { return escape_prefix + depth; }

// The neighbours' interval [low, high], its size, and what follows from it.
struct Interval {
    std::uint32_t low, high, size, context;
    std::uint32_t short_codes;  // of the truncated binary code: that many have one bit less

    Interval(std::uint32_t left, std::uint32_t top)
        : low(left < top ? left : top),
          high(left < top ? top : left),
          size(high - low + 1),
          context(floor_log2(size)),
          short_codes((2u << context) - size) {}
};

struct Code {
    std::uint64_t value;
    std::uint32_t length;
};

// No branch depends on the data but for the escape, which is rare: mispredictions would cost
// more than computing both codes.
inline Code encode_pixel(std::uint32_t x, std::uint32_t left, std::uint32_t top, const KTable &table,
                         std::uint32_t depth) {
    const Interval in(left, top);
    const std::uint32_t inside = x - in.low;  // wraps when below
    const std::uint32_t is_long = inside >= in.short_codes ? 1u : 0u;
    const std::uint32_t in_length = in.context + is_long;
    const std::uint32_t in_value = (1u << in_length) | (inside + (is_long ? in.short_codes : 0u));

    const std::uint32_t below = in.low - x - 1u;
    const std::uint32_t above = x - in.high - 1u;
    const std::uint32_t is_above = x > in.high ? 1u : 0u;
    const std::uint32_t distance = is_above ? above : below;
    const std::uint32_t k = table[in.context];
    const std::uint32_t quotient = distance >> k;
    const std::uint32_t remainder = distance & ((1u << k) - 1u);
    const std::uint32_t out_value = (((1u << k) | remainder) << 1) | is_above;

    const bool is_inside = inside < in.size;
    if (__builtin_expect(!is_inside & (quotient >= escape_zeros - 1u), 0)) {
        return {(std::uint64_t{1} << depth) | x, longest_code(depth)};
    }
    return {is_inside ? in_value : out_value, is_inside ? in_length + 1u : quotient + k + 3u};
}

struct Decoded {
    std::uint32_t value;
    std::uint32_t length;
    std::uint32_t wrong;  // not zero: no encoder writes this
};

// `bits` is left-aligned and holds at least longest_code(depth) valid bits.
inline Decoded decode_pixel(std::uint64_t bits, std::uint32_t left, std::uint32_t top, const KTable &table,
                            std::uint32_t depth) {
    const Interval in(left, top);
    const std::uint32_t whole = static_cast<std::uint32_t>((bits << 1) >> (63u - in.context));
    const std::uint32_t is_long = (whole >> 1) >= in.short_codes ? 1u : 0u;
    const std::uint32_t in_value = in.low + (is_long ? whole - in.short_codes : whole >> 1);
    const std::uint32_t in_length = 1u + in.context + is_long;

    // A sentinel ends the run of zeros at the escape's length, whatever follows.
    constexpr std::uint64_t sentinel = std::uint64_t{1} << (63u - escape_zeros);
    const std::uint32_t zeros = static_cast<std::uint32_t>(__builtin_clzll(bits | sentinel));
    if (__builtin_expect(zeros == escape_zeros, 0)) {
        const std::uint32_t raw = static_cast<std::uint32_t>((bits << escape_prefix) >> (64u - depth));
        return {raw, longest_code(depth), (bits & sentinel) == 0 ? 1u : 0u};
    }
    const std::uint32_t k = table[in.context];
    const std::uint32_t tail = static_cast<std::uint32_t>((bits << (zeros + 1u)) >> (63u - k));
    const std::uint32_t distance = ((zeros - 1u) << k) + (tail >> 1);
    const std::uint32_t out_value = (tail & 1u) ? in.high + 1u + distance : in.low - 1u - distance;
    const std::uint32_t out_length = zeros + k + 2u;

    const bool is_inside = (bits >> 63) != 0;
    const std::uint32_t value = is_inside ? in_value : out_value;
    return {value, is_inside ? in_length : out_length, value >> depth};  // a value below zero wraps
}

}  // namespace recorder
