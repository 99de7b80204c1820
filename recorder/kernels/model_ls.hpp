// The model felics-ls (docs/felics.md, "Model 2"): a least-squares prediction from six neighbours, and an
// interval about it whose width depends on the context.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "code.hpp"

namespace recorder {

constexpr std::uint32_t deepest_ls = 12;  // so that products and sums stay within 16 bits
constexpr std::uint32_t gradient_classes = 16;
constexpr std::uint32_t intensity_classes = 4;
constexpr std::uint32_t ls_contexts = gradient_classes * intensity_classes;
constexpr std::uint32_t ls_terms = 5;  // b - a, c - a, d - a, e - a, f - a
constexpr std::size_t ls_table_size = ls_contexts + 2 * ls_terms * gradient_classes;

struct LsTable {
    std::array<std::uint8_t, ls_contexts> codes;  // m + 16 k: the interval's size is 2^m
    std::array<std::array<std::int16_t, gradient_classes>, ls_terms> weights;
};

// The class of a sum of gradients at 10 bits: below 64 in steps of 4, from there in steps of 32 up to 511.
constexpr std::array<std::uint8_t, 16> small_gradient = {0, 1, 2, 3, 4, 5, 6, 6, 7, 7, 8, 8, 9, 9, 9, 9};
constexpr std::array<std::uint8_t, 16> large_gradient = {0,  0,  10, 11, 12, 12, 13, 13,
                                                         14, 14, 14, 14, 15, 15, 15, 15};
constexpr std::array<std::uint32_t, 3> intensity_limits = {32, 96, 272};

// A number of `depth` bits brought to the scale of 10.
inline std::uint32_t to_ten_bits(std::uint32_t x, std::uint32_t depth) {
    return depth >= 10 ? x >> (depth - 10u) : x << (10u - depth);
}

// f e c b d are the pixels two rows above, two to the left, and upper left, upper and upper right.
struct Neighbours {
    std::int32_t a, b, c, d, e, f;

    // At pixel x of a row, whose pixels before x are known. `above` and `above_2` are the rows above (both
    // the topmost one for row 1); `corner` is the left neighbour of above[0]. Not for the topmost row.
    Neighbours(const std::uint16_t *row, const std::uint16_t *above, const std::uint16_t *above_2,
               std::uint32_t corner, std::uint32_t width, std::uint32_t x)
        : a(x > 0 ? row[x - 1] : above[0]),
          b(above[x]),
          c(x > 0 ? above[x - 1] : static_cast<std::int32_t>(corner)),
          d(x + 1 < width ? above[x + 1] : b),
          e(x > 1 ? row[x - 2] : above[0]),
          f(above_2[x]) {}

    // In the topmost row the left neighbour stands for all above, and middle grey for what is outside.
    Neighbours(const std::uint16_t *row, std::uint32_t middle, std::uint32_t x)
        : a(x > 0 ? row[x - 1] : static_cast<std::int32_t>(middle)),
          b(a),
          c(a),
          d(a),
          e(x > 1 ? row[x - 2] : static_cast<std::int32_t>(middle)),
          f(a) {}

    std::uint32_t gradient_class(std::uint32_t depth) const {
        const auto sum = static_cast<std::uint32_t>(std::abs(a - c) + std::abs(c - b) + std::abs(b - d) + std::abs(a - e));
        const std::uint32_t scaled = to_ten_bits(sum, depth);
        return scaled < 64 ? small_gradient[scaled >> 2] : large_gradient[std::min(scaled, 511u) >> 5];
    }
    std::uint32_t intensity_class(std::uint32_t depth) const {
        const auto level = static_cast<std::uint32_t>((b + ((c + d + 1) >> 1) + 1) >> 1);
        const std::uint32_t scaled = to_ten_bits(level, depth);
        return (scaled >= intensity_limits[0]) + (scaled >= intensity_limits[1]) + (scaled >= intensity_limits[2]);
    }
    std::array<std::int32_t, ls_terms> terms() const { return {b - a, c - a, d - a, e - a, f - a}; }
};

inline std::int32_t saturate16(std::int32_t x) { return std::clamp(x, -32768, 32767); }

// What a pixel is expected to be: weights in 1/2^14, products in 1/2^(13 - depth), every sum held to 16 bits.
inline std::int32_t predict(const Neighbours &n, const LsTable &table, std::uint32_t gradient, std::uint32_t depth) {
    std::array<std::int32_t, ls_terms> p = n.terms();
    for (std::uint32_t i = 0; i < ls_terms; ++i)
        p[i] = (p[i] * (1 << (14u - depth)) * table.weights[i][gradient] + (1 << 14)) >> 15;
    const std::int32_t four = saturate16(saturate16(p[0] + p[1]) + saturate16(p[2] + p[3]));
    const std::uint32_t fraction = 13u - depth;
    const std::int32_t step = saturate16(saturate16(four + p[4]) + (1 << (fraction - 1u))) >> fraction;
    return std::clamp(n.a + step, 0, (1 << depth) - 1);
}

// The interval [low, low + 2^m) and the k beyond it.
struct LsInterval {
    std::int32_t low;
    std::uint32_t m, k;

    LsInterval(const Neighbours &n, const LsTable &table, std::uint32_t depth) {
        const std::uint32_t gradient = n.gradient_class(depth);
        const std::uint32_t code = table.codes[intensity_classes * gradient + n.intensity_class(depth)];
        m = code & 15u;
        k = code >> 4;
        low = predict(n, table, gradient, depth) - ((1 << m) >> 1);
    }
};

inline Code encode_ls_pixel(std::int32_t x, const LsInterval &in, std::uint32_t depth) {
    const std::int32_t inside = x - in.low, size = 1 << in.m;
    if (inside >= 0 && inside < size) return {static_cast<std::uint32_t>(size + inside), in.m + 1u};
    const std::uint32_t is_above = inside >= 0;
    const auto distance = static_cast<std::uint32_t>(is_above ? inside - size : -inside - 1);
    const std::uint32_t quotient = distance >> in.k;
    if (quotient > escape_zeros - 2u) return {(1u << depth) | static_cast<std::uint32_t>(x), longest_code(depth)};
    return {(2u << in.k) + ((distance - (quotient << in.k)) << 1) + is_above, quotient + in.k + 3u};
}

inline Decoded decode_ls_pixel(std::uint64_t bits, const LsInterval &in, std::uint32_t depth) {
    constexpr std::uint64_t sentinel = std::uint64_t{1} << (63u - escape_zeros);
    const auto zeros = static_cast<std::uint32_t>(__builtin_clzll(bits | sentinel));
    if (zeros == escape_zeros) {
        const auto raw = static_cast<std::uint32_t>((bits << escape_prefix) >> (64u - depth));
        return {raw, longest_code(depth), (bits & sentinel) == 0 ? 1u : 0u};
    }
    const std::uint32_t tail_length = zeros == 0 ? in.m : in.k + 1u;
    const auto tail = static_cast<std::int32_t>(((bits << (zeros + 1u)) >> 1) >> (63u - tail_length));
    std::int32_t value = in.low + tail;
    if (zeros != 0) {
        const std::int32_t distance = static_cast<std::int32_t>((zeros - 1u) << in.k) + (tail >> 1);
        value = (tail & 1) != 0 ? in.low + (1 << in.m) + distance : in.low - 1 - distance;
    }
    const auto wrapped = static_cast<std::uint32_t>(value);  // below zero: far above the depth
    return {wrapped, zeros + 1u + tail_length, wrapped >> depth};
}

}  // namespace recorder
