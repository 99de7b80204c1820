// What both models' decoders share: reading the code words of one vector's lanes. The bits are taken in 32-bit
// lanes; their meaning is worked out in 16-bit ones, because no value of up to twelve bits, nor anything on
// the way to it, needs more, and a vector holds twice as many.
#pragma once

#include "code.hpp"
#include "wide.hpp"

namespace recorder::RECORDER_VECTOR {

// Two code words and the bits of a byte before them fit 64 bits, and 8 << k with anything added 16.
constexpr std::uint32_t deepest_decoded = 12;

// The interval of each lane's pixel and the codes that go with it. A code word is read as bits >> shift, where
// shift is 32 less its length: leading zeros vanish, and the one behind them stays as its highest bit.
struct CodeLanes {
    Lanes low, size;       // the interval [low, low + size)
    Lanes inside_shift;    // of a word inside
    Lanes divisor;         // 2^k
    Lanes k_biased;        // k + outside_bias
};

// The exponent of a word's highest bits as a float is this less the number of leading zeros.
constexpr std::uint32_t exponent_of_first = 127 + 31;
// So much above k is the exponent's excess over a word's shift outside: zeros, a one, k bits, the side.
constexpr std::uint32_t outside_bias = exponent_of_first - 30;

struct Inside {
    Lanes value, shift;
};

// What the lanes' streams have shown so far.
struct Evidence {
    Lanes values;    // ored: no bit is above the depth
    Lanes exponent;  // the smallest: zero is a run of ten zeros, which means no pixel
};

class CodeReader {
  public:
    CodeReader(const std::uint8_t *payload, std::size_t size, std::uint32_t depth)
        : source_(payload),
          raw_shift_(32u - longest_code(depth)),
          limit_(kept(all32(static_cast<std::uint32_t>(8 * size) + 64u))),
          raw_mask_(kept(all16((1u << depth) - 1u))),
          escape_length_(kept(all16(longest_code(depth)))) {}

    using Offsets = BigEndianGather::Offsets;
    RECORDER_INLINE void prepare(Offsets &offsets, const Wide &cursor) const {
        BigEndianGather::prepare(offsets, right32<3>(cursor));
    }
    RECORDER_INLINE Words load(const Offsets &offsets) const { return source_.load(offsets); }

    // The 25 or more bits behind the first `skipped`, 0 to 7 of them, and the 32 bits behind up to 31.
    RECORDER_INLINE Wide first_bits(const Words &words, const Wide &skipped) const {
        return left_by32(words.first, skipped);
    }
    RECORDER_INLINE Wide next_bits(const Words &words, const Wide &skipped) const {
        return both(left_by32(words.first, skipped), right_by32(words.second, sub32(all32(32), skipped)));
    }
    RECORDER_INLINE Wide skipped_in_byte(const Wide &cursor) const { return common(cursor, all32(7)); }
    // Never far beyond the payload, whatever is read.
    RECORDER_INLINE Wide moved(const Wide &cursor, Lanes lengths) const {
        return min32(add32(cursor, widened(lengths)), limit_);
    }

    struct Pixels {
        Lanes value, length;
    };
    // decode_pixel of code.hpp: reads the code word at the head of `bits`, where `inside(word)` reads the one of
    // a pixel inside the interval.
    template <typename ReadInside>
    RECORDER_INLINE Pixels read(const Wide &bits, const CodeLanes &code, Evidence &evidence, ReadInside inside) const {
        // The ten highest bits tell all; with so few the conversion to float does not round.
        const Wide exponents = exponent32(common(bits, all32(~0u << (32u - escape_prefix))));
        const Lanes exponent = narrowed(exponents);
        const Lanes word_outside = narrowed(right_by32(bits, sub32(exponents, widened(code.k_biased))));
        const Inside in = inside(narrowed(right_by32(bits, widened(code.inside_shift))));

        // distance = (zeros - 1) 2^k + remainder, and half a word is 2^k + remainder.
        const Lanes zeros_less_two = sub16(all16(exponent_of_first - 2), exponent);
        const Lanes distance = add16(multiply16(zeros_less_two, code.divisor), right16<1>(word_outside));
        const Lanes is_below = sub16(common(word_outside, all16(1)), all16(1));
        const Lanes outside =
            add16(add16(code.low, and_not(is_below, code.size)), differing(distance, is_below));

        const Lanes is_inside = greater16(exponent, all16(255));  // the sign, which is the first bit
        const Lanes is_escape = greater16(all16(exponent_of_first - escape_zeros + 1), exponent);
        const Lanes raw = common(narrowed(right32_by(bits, raw_shift_)), raw_mask_);
        const Lanes value = choose(is_escape, raw, choose(is_inside, in.value, outside));
        const Lanes shift = choose(is_inside, in.shift, sub16(exponent, code.k_biased));
        const Lanes length = choose(is_escape, escape_length_, sub16(all16(32), shift));

        evidence.values = both(evidence.values, value);
        evidence.exponent = min16(evidence.exponent, exponent);
        return {value, length};
    }

  private:
    BigEndianGather source_;
    std::uint32_t raw_shift_;
    Lanes limit_, raw_mask_, escape_length_;
};

}  // namespace recorder::RECORDER_VECTOR
