#include <cmath>

#include "felics.hpp"
#include "model_ls.hpp"
#include "rows.hpp"
#include "scratch.hpp"

namespace recorder {
namespace {

constexpr std::uint32_t row_step = 32;
constexpr std::uint32_t fewest_samples = 32;  // of a gradient class, to fit weights to it

// Calls visit(neighbours, pixel) for every 32nd row from the middle of the first 32 on, without its ends.
template <typename Visit>
void sample(const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height, Visit visit) {
    for (std::uint32_t y = std::max(1u, std::min(row_step, height) / 2); y < height; y += row_step) {
        const std::uint16_t *row = pixels + std::size_t{y} * width, *above = row - width;
        const std::uint16_t *above_2 = y > 1 ? above - width : above;
        for (std::uint32_t x = 1; x + 1 < width; ++x) visit(Neighbours(row, above, above_2, 0, width, x), row[x]);
    }
}

// The normal equations of one gradient class, in whole numbers: every build sums alike.
struct Equations {
    std::array<std::array<std::int64_t, ls_terms + 1>, ls_terms> sums{};
    std::uint32_t samples = 0;

    void add(const std::array<std::int32_t, ls_terms> &terms, std::int32_t wanted) {
        for (std::uint32_t i = 0; i < ls_terms; ++i) {
            for (std::uint32_t j = i; j < ls_terms; ++j) sums[i][j] += std::int64_t{terms[i]} * terms[j];
            sums[i][ls_terms] += std::int64_t{terms[i]} * wanted;
        }
        ++samples;
    }

    // By Gaussian elimination; a small ridge keeps constant pictures solvable.
    std::array<double, ls_terms> solve() const {
        std::array<std::array<double, ls_terms + 1>, ls_terms> m{};
        double trace = 0;
        for (std::uint32_t i = 0; i < ls_terms; ++i) trace += static_cast<double>(sums[i][i]);
        for (std::uint32_t i = 0; i < ls_terms; ++i) {
            for (std::uint32_t j = 0; j <= ls_terms; ++j)
                m[i][j] = static_cast<double>(j < i ? sums[j][i] : sums[i][j]);
            m[i][i] += 1.0 + 2e-4 * trace;
        }
        for (std::uint32_t i = 0; i < ls_terms; ++i)
            for (std::uint32_t r = i + 1; r < ls_terms; ++r) {
                const double factor = m[r][i] / m[i][i];
                for (std::uint32_t j = i; j <= ls_terms; ++j) m[r][j] -= factor * m[i][j];
            }
        std::array<double, ls_terms> solution{};
        for (std::uint32_t i = ls_terms; i-- > 0;) {
            double rest = m[i][ls_terms];
            for (std::uint32_t j = i + 1; j < ls_terms; ++j) rest -= m[i][j] * solution[j];
            solution[i] = rest / m[i][i];
        }
        return solution;
    }
};

// Counts of x - prediction in one context, as sums from the smallest difference on.
class Residuals {
  public:
    Residuals(const std::uint32_t *sums, std::uint32_t depth) : sums_(sums), depth_(depth), span_(1 << depth) {}

    std::uint32_t all() const { return through(span_ - 1); }

    std::uint64_t bits(std::uint32_t m, std::uint32_t k) const {
        const std::int32_t low = -((1 << m) >> 1), high = low + (1 << m);
        const std::uint32_t in = through(high - 1) - through(low - 1);
        std::uint64_t sum = std::uint64_t{in} * (m + 1u);
        std::uint32_t counted = in;
        for (std::uint32_t quotient = 0; quotient < escape_zeros - 1u; ++quotient) {
            const std::int32_t near = static_cast<std::int32_t>(quotient << k), far = near + (1 << k);
            const std::uint32_t here = through(high + far - 1) - through(high + near - 1) +
                                       through(low - near - 1) - through(low - far - 1);
            sum += std::uint64_t{here} * (quotient + k + 3u);
            counted += here;
        }
        return sum + std::uint64_t{all() - counted} * longest_code(depth_);
    }

  private:
    std::uint32_t through(std::int32_t difference) const {
        return difference < -span_ ? 0 : sums_[std::min(difference, span_ - 1) + span_];
    }

    const std::uint32_t *sums_;
    std::uint32_t depth_;
    std::int32_t span_;
};

std::uint8_t best_code(std::uint32_t *counts, std::uint32_t depth, std::uint32_t usual) {
    for (std::uint32_t i = 1; i < 2u << depth; ++i) counts[i] += counts[i - 1];
    const Residuals residuals(counts, depth);
    std::uint64_t fewest = ~std::uint64_t{0};
    std::uint32_t best = usual;
    for (std::uint32_t m = 0; residuals.all() != 0 && m <= depth; ++m)
        for (std::uint32_t k = m > 4 ? m - 4 : 0; k <= std::min(m + 2u, depth); ++k)
            if (const std::uint64_t bits = residuals.bits(m, k); bits < fewest) {
                fewest = bits;
                best = m | k << 4;
            }
    return static_cast<std::uint8_t>(best);
}

}  // namespace

LsTable train_ls_table(const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height, std::uint32_t depth) {
    for (std::uint32_t y = 0; y < height; ++y) check_row(pixels + std::size_t{y} * width, width, depth);
    std::array<Equations, gradient_classes> equations;
    sample(pixels, width, height, [&](const Neighbours &n, std::int32_t x) {
        equations[n.gradient_class(depth)].add(n.terms(), x - n.a);
    });
    LsTable table{};
    for (std::uint32_t g = 0; g < gradient_classes; ++g) {
        // Where a class hardly occurs: the mean of a and b.
        std::array<double, ls_terms> weights = {0.5, 0, 0, 0, 0};
        if (equations[g].samples >= fewest_samples) weights = equations[g].solve();
        for (std::uint32_t i = 0; i < ls_terms; ++i)
            table.weights[i][g] = static_cast<std::int16_t>(std::clamp(std::round(weights[i] * 16384), -32768.0, 32767.0));
    }

    thread_local Scratch<std::uint32_t> scratch;
    const std::size_t span = std::size_t{2} << depth;
    std::uint32_t *counts = scratch.reserve(ls_contexts * span);
    std::fill_n(counts, ls_contexts * span, 0u);
    const std::int32_t top = (1 << depth) - 1;
    sample(pixels, width, height, [&](const Neighbours &n, std::int32_t x) {
        const std::uint32_t gradient = n.gradient_class(depth);
        const std::uint32_t context = intensity_classes * gradient + n.intensity_class(depth);
        // Never outside, even if another thread changes the row after it was checked.
        const std::int32_t difference = std::min(x, top) - predict(n, table, gradient, depth);
        ++counts[context * span + static_cast<std::size_t>(difference + (1 << depth))];
    });
    for (std::uint32_t context = 0; context < ls_contexts; ++context) {
        const std::uint32_t m = std::min(2u + context / 8u, depth);
        table.codes[context] = best_code(counts + context * span, depth, m | m << 4);
    }
    return table;
}

}  // namespace recorder
