#include <algorithm>

#include "cpu.hpp"
#include "felics.hpp"
#include "rows.hpp"
#include "scratch.hpp"

namespace recorder {
namespace {

constexpr std::uint32_t row_step = 32;  // codec-facts: every 32nd row loses nothing measurable
constexpr std::uint32_t largest_k = 15;

// How often each distance outside the interval occurs in each context; slot 0 takes the pixels inside.
struct Histogram {
    std::uint32_t *counts;
    std::uint32_t depth;

    static std::size_t size(std::uint32_t depth) { return 1 + ((std::size_t{depth} + 1) << depth); }
    std::uint32_t *of(std::uint32_t context) const { return counts + 1 + (std::size_t{context} << depth); }
};

// First where each pixel is counted, which is a few vector instructions where the processor has them,
// then the counting.
[[gnu::always_inline]] inline void add_row(const Histogram &histogram, const std::uint16_t *row,
                                           const std::uint16_t *tops, std::uint32_t width) {
    constexpr std::uint32_t block = 256;
    std::uint32_t slots[block];
    const auto last = static_cast<std::uint32_t>(Histogram::size(histogram.depth) - 1);
    for (std::uint32_t begin = 1; begin < width; begin += block) {
        const std::uint32_t count = std::min(block, width - begin);
        const std::uint16_t *pixels = row + begin, *lefts = pixels - 1, *uppers = tops + begin - 1;
        for (std::uint32_t i = 0; i < count; ++i) {
            const std::uint32_t value = pixels[i];
            const Interval<floor_log2_by_float> in(lefts[i], uppers[i]);
            const std::uint32_t is_above = negative_mask(in.high - value), is_below = negative_mask(value - in.low);
            const std::uint32_t distance = select(is_above, value - in.high, in.low - value) - 1u;
            // Never outside, even if another thread changes the row after it was checked.
            const std::uint32_t slot = std::min(1u + (in.context << histogram.depth) + distance, last);
            slots[i] = slot & (is_above | is_below);
        }
        for (std::uint32_t i = 0; i < count; ++i) ++histogram.counts[slots[i]];
    }
}

using AddRow = void (*)(const Histogram &, const std::uint16_t *, const std::uint16_t *, std::uint32_t);

void add_row_anywhere(const Histogram &histogram, const std::uint16_t *row, const std::uint16_t *tops,
                      std::uint32_t width) {
    add_row(histogram, row, tops, width);
}

RECORDER_WIDE void add_row_wide(const Histogram &histogram, const std::uint16_t *row, const std::uint16_t *tops,
                                std::uint32_t width) {
    add_row(histogram, row, tops, width);
}

// The k of the fewest bits, the smallest among equals, or `usual` if nothing was counted. Turns the counts
// into sums from distance 0 on: then a k needs only the eight quotients' borders.
std::uint32_t best_k(std::uint32_t *counts, std::uint32_t depth, std::uint32_t usual) {
    const std::uint32_t distances = 1u << depth;
    for (std::uint32_t d = 1; d < distances; ++d) counts[d] += counts[d - 1];
    const std::uint32_t all = counts[distances - 1];
    std::uint64_t fewest = ~std::uint64_t{0};
    std::uint32_t best = usual;
    for (std::uint32_t k = 0; all != 0 && k <= std::min(largest_k, depth); ++k) {
        std::uint64_t bits = 0;
        std::uint32_t before = 0;
        for (std::uint32_t quotient = 0; quotient < escape_zeros - 1u; ++quotient) {
            const std::uint32_t through = counts[std::min(distances, (quotient + 1u) << k) - 1u];
            bits += std::uint64_t{through - before} * (quotient + k + 3u);
            before = through;
        }
        bits += std::uint64_t{all - before} * longest_code(depth);
        if (bits < fewest) {
            fewest = bits;
            best = k;
        }
    }
    return best;
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
    thread_local Scratch<std::uint32_t> scratch;
    const std::size_t size = Histogram::size(depth);
    const Histogram histogram{scratch.reserve(size), depth};
    std::fill_n(histogram.counts, size, 0u);
    const AddRow add = has_wide() ? add_row_wide : add_row_anywhere;
    // From the middle of the first 32 rows on: the topmost row has no row above it to learn from.
    for (std::uint32_t y = std::min(row_step, height) / 2; y < height; y += row_step) {
        const std::uint16_t *row = pixels + std::size_t{y} * width, *tops = y > 0 ? row - width + 1 : row;
        check_row(row, width, depth);
        check_row(y > 0 ? row - width : row, width, depth);
        add(histogram, row, tops, width);
    }
    KTable table = usual_table(depth);
    for (std::uint32_t c = 0; c <= depth; ++c)
        table[c] = static_cast<std::uint8_t>(best_k(histogram.of(c), depth, table[c]));
    return table;
}

}  // namespace recorder
