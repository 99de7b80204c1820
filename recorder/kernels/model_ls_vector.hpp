// LsInterval of model_ls.hpp in 16-bit lanes.
#pragma once

#include "lanes.hpp"
#include "model_ls.hpp"

namespace recorder::RECORDER_VECTOR {

struct LsNeighbourLanes {
    Lanes a, b, c, d, e, f;
};

// The prediction, and m and k twice: the same byte in both halves of each lane.
struct LsLanes {
    Lanes prediction, m_twice, k_twice;
};

class LsModel {
  public:
    LsModel(const LsTable &table, std::uint32_t depth)
        : shift_up_(depth < 10 ? 10 - depth : 0),
          shift_down_(depth > 10 ? depth - 10 : 0),
          term_shift_(14 - depth),
          fraction_(13 - depth),
          rounding_(kept(all16(1u << (12 - depth)))),
          largest_(kept(all16((1u << depth) - 1u))) {
        for (std::uint32_t i = 0; i < intensity_classes; ++i) {
            alignas(16) std::uint8_t codes[gradient_classes];
            for (std::uint32_t g = 0; g < gradient_classes; ++g) codes[g] = table.codes[intensity_classes * g + i];
            codes_[i] = kept(table16(codes));
        }
        for (std::uint32_t i = 0; i < ls_terms; ++i) {
            alignas(16) std::uint8_t low[gradient_classes], high[gradient_classes];
            for (std::uint32_t g = 0; g < gradient_classes; ++g) {
                low[g] = static_cast<std::uint8_t>(table.weights[i][g] & 255);
                high[g] = static_cast<std::uint8_t>((table.weights[i][g] >> 8) & 255);
            }
            low_weights_[i] = kept(table16(low));
            high_weights_[i] = kept(table16(high));
        }
        for (std::uint32_t i = 0; i < intensity_limits.size(); ++i) {
            // At another depth the limit is the first level that is brought to it.
            const std::uint32_t limit = depth >= 10 ? intensity_limits[i] << shift_down_
                                                    : (intensity_limits[i] + (1u << shift_up_) - 1u) >> shift_up_;
            below_limits_[i] = kept(all16(limit - 1u));
        }
    }

    RECORDER_INLINE LsLanes apply(const LsNeighbourLanes &n) const {
        const Lanes from_c = sub16(n.c, n.a), from_e = sub16(n.e, n.a);
        const Lanes slopes = add16(add16(abs16(from_c), abs16(from_e)),
                                   add16(abs16(sub16(n.c, n.b)), abs16(sub16(n.b, n.d))));
        const Lanes sum = right16_by(left16_by(slopes, shift_up_), shift_down_);
        const Lanes small = look_up(small_classes_, right16<2>(sum));
        const Lanes large = look_up(large_classes_, right16<5>(min16(sum, all16(511))));
        const Lanes gradient = choose(greater16(sum, all16(63)), large, small);
        const Lanes gradient_twice = both(gradient, left16<8>(gradient));

        const Lanes level = average16(n.b, average16(n.c, n.d));
        Lanes code = look_up(codes_[0], gradient_twice);
        for (std::uint32_t i = 0; i < intensity_limits.size(); ++i)
            code = choose(greater16(level, below_limits_[i]), look_up(codes_[i + 1], gradient_twice), code);

        const Lanes low_index = both(gradient_twice, high_bit_), high_index = both(gradient_twice, low_bit_);
        const auto product = [&](std::uint32_t i, Lanes term) {
            const Lanes weight = both(look_up(low_weights_[i], low_index), look_up(high_weights_[i], high_index));
            return multiply_round16(left16_by(term, term_shift_), weight);
        };
        const Lanes two = saturating_add16(product(0, sub16(n.b, n.a)), product(1, from_c));
        const Lanes four = saturating_add16(two, saturating_add16(product(2, sub16(n.d, n.a)), product(3, from_e)));
        const Lanes all = saturating_add16(four, product(4, sub16(n.f, n.a)));
        const Lanes step = signed_right16_by(saturating_add16(all, rounding_), fraction_);
        const Lanes prediction = signed_min16(signed_max16(add16(n.a, step), zero()), largest_);
        return {prediction, common(code, nibble_), common(right16<4>(code), nibble_)};
    }

  private:
    std::uint32_t shift_up_, shift_down_, term_shift_, fraction_;
    Lanes rounding_, largest_;
    Lanes codes_[intensity_classes], low_weights_[ls_terms], high_weights_[ls_terms];
    Lanes below_limits_[intensity_limits.size()];
    Lanes small_classes_ = kept(table16(small_gradient.data())), large_classes_ = kept(table16(large_gradient.data()));
    Lanes nibble_ = kept(all16(0x0F0F)), high_bit_ = kept(all16(0x8000)), low_bit_ = kept(all16(0x0080));
};

}  // namespace recorder::RECORDER_VECTOR
