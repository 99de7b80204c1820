// Brings the code words of a step's pixels into a few words of up to 63 bits: neighbours are merged in ever wider
// numbers, 16 to 32 to 64 bits, so that few are left to be appended one after another.
#pragma once

#include "bits.hpp"
#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::uint32_t step_pixels = 2 * lanes16;

RECORDER_INLINE void prefetch_step(const std::uint16_t *pixels) {
    for (std::uint32_t i = 0; i < step_pixels; i += 32) prefetch(pixels + i);  // 64 bytes each
}

// Code words right-aligned in 16 bits (the leading zeros of a word may stand outside), with their lengths.
struct Codes {
    Lanes values, lengths;
};

// The words of a few steps on their way from the vector unit to the stream: the two take turns block by
// block, so that neither waits for the other's results.
class WordBlock {
  public:
    static constexpr std::uint32_t steps = 16;

    void append_to(WordWriter &writer) {
        WordWriter out = writer;
        const std::uint64_t *lengths = lengths_;
        for (const std::uint64_t *words = words_, *end = words_ + count_; words != end; words += 4, lengths += 4)
            for (int i = 0; i < 4; ++i) out.append(words[i], lengths[i]);
        writer = out;
        count_ = 0;
    }

    RECORDER_INLINE void put(Lanes words, Lanes lengths) {
        store(words_ + count_, words);
        store(lengths_ + count_, lengths);
        count_ += sizeof(Lanes) / sizeof *words_;
    }

    // Out of line: one step in hundreds of a usual picture.
    template <typename Number>
    [[gnu::noinline]] void put_each(const Codes *codes) {
        constexpr std::uint32_t numbers = sizeof(Lanes) / sizeof(Number);
        for (std::uint32_t i = 0; i < 2; ++i) {
            alignas(sizeof(Lanes)) Number values[numbers], lengths[numbers];
            store(values, codes[i].values);
            store(lengths, codes[i].lengths);
            for (std::uint32_t j = 0; j < numbers; ++j, ++count_) {
                lengths_[count_] = lengths[j];
                words_[count_] = (std::uint64_t{values[j]} << 1) << (63u - lengths_[count_]);
            }
        }
    }

  private:
    alignas(sizeof(Lanes)) std::uint64_t words_[steps * step_pixels], lengths_[steps * step_pixels];
    std::uint32_t count_ = 0;
};

class Merger {
  public:
    // A code word's value has up to depth + 2 bits.
    explicit Merger(std::uint32_t depth) : longest_second_(30u - depth) {}

    RECORDER_INLINE void merge(const Codes &first, const Codes &second, WordBlock &block) const {
        // In 32 bits the value of one word must fit before all of the next.
        if (longest_second_ < longest_usual) {
            const Lanes longest = max32(right32<16>(first.lengths), right32<16>(second.lengths));
            if (__builtin_expect(any(greater32(longest, all32(longest_second_))), 0)) {
                const Codes codes[2] = {first, second};
                block.put_each<std::uint16_t>(codes);
                return;
            }
        }
        const Codes pairs[2] = {merge_pairs(first), merge_pairs(second)};
        const Codes fours[2] = {merge_fours(pairs[0]), merge_fours(pairs[1])};
        if (__builtin_expect(any(greater32(max32(fours[0].lengths, fours[1].lengths), longest_word_)), 0)) {
            block.put_each<std::uint32_t>(pairs);
            return;
        }
        for (const Codes &four : fours) block.put(left_by64(four.values, sub64(word_bits_, four.lengths)), four.lengths);
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

    std::uint32_t longest_second_;
    Lanes low16_ = kept(all32(0xFFFFu)), low32_ = kept(all64(0xFFFFFFFFu));
    Lanes ones_ = kept(all16(1)), word_bits_ = kept(all64(64)), longest_word_ = kept(all64(63));
};

}  // namespace recorder::RECORDER_VECTOR
