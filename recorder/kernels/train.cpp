#include <algorithm>

#include "felics.hpp"

namespace recorder {
namespace {

constexpr std::uint32_t row_step = 32;  // codec-facts: every 32nd row loses nothing measurable
constexpr std::uint32_t largest_k = 15;

// Bits of out-of-range distances in one context, for every k at once.
using Costs = std::array<std::array<std::uint64_t, largest_k + 1>, contexts>;

void add_row(Costs &costs, const std::uint16_t *row, const std::uint16_t *tops, std::uint32_t width,
             std::uint32_t depth, std::uint32_t ks) {
    for (std::uint32_t x = 1; x < width; ++x) {
        const std::uint32_t left = row[x - 1], top = tops[x - 1], value = row[x];
        const Interval<floor_log2> in(left, top);
        if (value - in.low < in.size) continue;
        const std::uint32_t distance = value > in.high ? value - in.high - 1u : in.low - value - 1u;
        for (std::uint32_t k = 0; k < ks; ++k) {
            const std::uint32_t quotient = distance >> k;
            costs[in.context][k] += quotient < escape_zeros - 1u ? quotient + k + 3u : longest_code(depth);
        }
    }
}

}  // namespace

KTable usual_table(std::uint32_t depth) {
    constexpr KTable usual = {2, 2, 2, 2, 3, 4, 4, 4, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    KTable table{};
    for (std::uint32_t c = 0; c < contexts; ++c)
        table[c] = std::min(usual[c], static_cast<std::uint8_t>(depth));
    return table;
}

KTable train_table(const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height, std::uint32_t depth) {
    const std::uint32_t ks = std::min(largest_k, depth) + 1;
    Costs costs{};
    // From the middle of the first 32 rows on: the topmost row has no row above it to learn from.
    for (std::uint32_t y = std::min(row_step, height) / 2; y < height; y += row_step) {
        const std::uint16_t *row = pixels + std::size_t{y} * width;
        add_row(costs, row, y > 0 ? row - width + 1 : row, width, depth, ks);
    }
    KTable table = usual_table(depth);
    for (std::uint32_t c = 0; c < contexts; ++c) {
        if (costs[c][0] == 0) continue;
        const auto best = std::min_element(costs[c].begin(), costs[c].begin() + ks);
        table[c] = static_cast<std::uint8_t>(best - costs[c].begin());
    }
    return table;
}

}  // namespace recorder
