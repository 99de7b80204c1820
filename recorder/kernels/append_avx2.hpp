// Appends 32 code words at once: neighbours are merged in ever wider numbers, 16 to 32 to 64 bits, so that
// only the last step, four or eight appends for 32 pixels, goes one after another.
#pragma once

#include "bits.hpp"
#include "lanes_avx2.hpp"

namespace recorder::avx2 {

constexpr std::uint32_t step_pixels = 2 * lanes16;

// Code words right-aligned in 16 bits (the leading zeros of a word may stand outside), with their lengths.
struct Codes {
    Lanes values, lengths;
};

// Out of line: one step in hundreds of a usual picture.
template <typename Number>
[[gnu::noinline]] WordWriter append_each(WordWriter writer, const Codes *codes) {
    constexpr std::uint32_t count = sizeof(Lanes) / sizeof(Number);
    for (std::uint32_t i = 0; i < 2; ++i) {
        alignas(32) Number values[count], lengths[count];
        store(values, codes[i].values);
        store(lengths, codes[i].lengths);
        for (std::uint32_t j = 0; j < count; ++j) {
            const std::uint32_t length = static_cast<std::uint32_t>(lengths[j]);
            writer.append((std::uint64_t{values[j]} << 1) << (63u - length), length);
        }
    }
    return writer;
}

class Appender {
  public:
    // `depth`: a code word's value has up to depth + 2 bits. `eights`: merge once more, which is faster where
    // eight words seldom exceed 64 bits.
    Appender(std::uint32_t depth, bool eights) : longest_second_(30u - depth), eights_(eights) {}

    RECORDER_INLINE void append(WordWriter &writer, const Codes &first, const Codes &second) const {
        // In 32 bits the value of one word must fit before all of the next.
        if (longest_second_ < longest_usual) {
            const Lanes longest = max32(right32<16>(first.lengths), right32<16>(second.lengths));
            if (__builtin_expect(any(greater32(longest, all32(longest_second_))), 0)) {
                const Codes codes[2] = {first, second};
                writer = append_each<std::uint16_t>(writer, codes);
                return;
            }
        }
        const Codes pairs[2] = {merge_pairs(first), merge_pairs(second)};
        const Codes fours[2] = {merge_fours(pairs[0]), merge_fours(pairs[1])};
        alignas(32) std::uint64_t words[8], bits[8];
        if (eights_) {
            const Lanes second_lengths = seconds64(fours[0].lengths, fours[1].lengths);
            const Lanes lengths = add32(firsts64(fours[0].lengths, fours[1].lengths), second_lengths);
            if (__builtin_expect(!any(greater32(lengths, word_bits_)), 1)) {
                const Lanes values = both(left_by64(firsts64(fours[0].values, fours[1].values), second_lengths),
                                          seconds64(fours[0].values, fours[1].values));
                store(words, align_left64({values, lengths}));
                store(bits, lengths);
                for (const int i : {0, 2, 1, 3}) writer.append(words[i], static_cast<std::uint32_t>(bits[i]));
                return;
            }
        }
        if (__builtin_expect(any(greater32(max32(fours[0].lengths, fours[1].lengths), word_bits_)), 0)) {
            writer = append_each<std::uint32_t>(writer, pairs);
            return;
        }
        for (int i = 0; i < 2; ++i) {
            store(words + 4 * i, align_left64(fours[i]));
            store(bits + 4 * i, fours[i].lengths);
        }
        for (int i = 0; i < 8; ++i) writer.append(words[i], static_cast<std::uint32_t>(bits[i]));
    }

  private:
    static constexpr std::uint32_t longest_usual = 20;  // up to a depth of 10, no word is longer

    RECORDER_INLINE Codes merge_pairs(const Codes &codes) const {
        const Lanes second_lengths = right32<16>(codes.lengths), firsts = common(codes.values, low16_);
        return {both(left_by32(firsts, second_lengths), right32<16>(codes.values)), dot_pairs16(codes.lengths, ones_)};
    }
    RECORDER_INLINE Codes merge_fours(const Codes &pairs) const {
        const Lanes second_lengths = right64<32>(pairs.lengths), firsts = common(pairs.values, low32_);
        return {both(left_by64(firsts, second_lengths), right64<32>(pairs.values)),
                common(add32(pairs.lengths, second_lengths), low32_)};
    }
    RECORDER_INLINE Lanes align_left64(const Codes &words) const {
        return left_by64(words.values, sub64(word_bits_, words.lengths));
    }

    std::uint32_t longest_second_;
    bool eights_;
    Lanes low16_ = kept(all32(0xFFFFu)), low32_ = kept(all64(0xFFFFFFFFu));
    Lanes ones_ = kept(all16(1)), word_bits_ = kept(all64(64));
};

}  // namespace recorder::avx2
