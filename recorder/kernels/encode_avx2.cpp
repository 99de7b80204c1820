#include "encode_avx2.hpp"

#include <algorithm>
#include <cstring>

#include "append_avx2.hpp"
#include "checksum_avx2.hpp"
#include "logarithm_avx2.hpp"

namespace recorder::avx2 {
namespace {

// encode_pixel of code.hpp. Numbers with "_twice" hold the same byte twice, as table indices do.
class PixelEncoder {
  public:
    PixelEncoder(const KTable &table, std::uint32_t depth)
        : escape_one_(kept(all16(1u << depth))), escape_length_(kept(all16(longest_code(depth)))) {
        alignas(16) std::uint8_t ks[16], rests[16];
        for (std::size_t c = 0; c < 16; ++c) {
            ks[c] = table[c];
            rests[c] = static_cast<std::uint8_t>(15 - ks[c]);
        }
        k_ = kept(table16(ks));
        fifteen_minus_k_ = kept(table16(rests));
    }

    RECORDER_INLINE Codes encode(Lanes x, Lanes left, Lanes top) const {
        const Lanes low = min16(left, top), high = max16(left, top);
        const Lanes size = add16(sub16(high, low), one_);
        const Lanes context_twice = powers_.log2_twice(size), power = powers_.power(context_twice);

        // Inside: the prefix and v, or one bit more and v + t.
        const Lanes short_codes = sub16(add16(power, power), size);
        const Lanes inside_value = sub16(x, low);
        const Lanes is_short = greater16(short_codes, inside_value);
        const Lanes inside_code = add16(add16(power, inside_value), and_not(is_short, add16(power, short_codes)));

        // Outside: the prefix, the remainder and the side; the zeros before it are only counted.
        const Lanes beyond = both(monus16(low, x), monus16(x, high));
        const Lanes is_inside = equal16(beyond, zero());
        const Lanes distance = monus16(beyond, one_);
        const Lanes k_twice = look_up(k_, context_twice), divisor = powers_.power(k_twice);
        const Lanes quotient = multiply_high16(add16(distance, distance),
                                               powers_.power(look_up(fifteen_minus_k_, context_twice)));
        const Lanes remainder = common(distance, sub16(divisor, one_));
        const Lanes half = add16(divisor, remainder);
        const Lanes outside_code = sub16(add16(half, half), greater16(x, high));

        const Lanes tail = common(choose(is_inside, context_twice, k_twice), low_byte_);
        const Lanes rest = choose(is_inside, is_short, add16(quotient, one_));
        const Lanes length = add16(add16(tail, rest), two_);
        const Lanes value = choose(is_inside, inside_code, outside_code);

        const Lanes is_escape = greater16(quotient, last_quotient_);
        return {choose(is_escape, both(x, escape_one_), value), choose(is_escape, escape_length_, length)};
    }

  private:
    Powers powers_;
    Lanes k_, fifteen_minus_k_, escape_one_, escape_length_;
    Lanes one_ = kept(all16(1)), two_ = kept(all16(2)), low_byte_ = kept(all16(0xFF));
    Lanes last_quotient_ = kept(all16(escape_zeros - 2));
};

// The rest of a row in a full step, with code words of no bits behind its end.
void encode_rest(const PixelEncoder &encoder, const Merger &merger, WordBlock &block, const std::uint16_t *row,
                 const std::uint16_t *tops, std::uint32_t count) {
    std::uint16_t lefts[step_pixels] = {}, pixels[step_pixels] = {}, uppers[step_pixels] = {};
    std::uint16_t wanted[step_pixels] = {};
    std::memcpy(lefts, row - 1, count * sizeof *row);
    std::memcpy(pixels, row, count * sizeof *row);
    std::memcpy(uppers, tops, count * sizeof *row);
    std::memset(wanted, 0xFF, count * sizeof *row);
    Codes codes[2];
    for (std::uint32_t i = 0; i < 2; ++i) {
        const std::uint32_t at = i * lanes16;
        codes[i] = encoder.encode(load(pixels + at), load(lefts + at), load(uppers + at));
        codes[i] = {common(codes[i].values, load(wanted + at)), common(codes[i].lengths, load(wanted + at))};
    }
    merger.merge(codes[0], codes[1], block);
}

}  // namespace

std::uint32_t encode_row(BitWriter &bits, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth,
                         const KTable &table, std::uint32_t first_crc) {
    const PixelEncoder encoder(table, depth);
    const Merger merger(depth);
    const std::uint16_t *tops = row - width;
    WordWriter writer(bits);
    WordBlock block;
    std::uint64_t crc = first_crc;

    // In the first column the upper neighbour stands for the left one.
    Lanes lefts = choose(first_lane16(), load(tops), load(row - 1));
    std::uint32_t x = 0;
    while (x + step_pixels <= width) {
        const std::uint32_t end = std::min(width - step_pixels, x + (WordBlock::steps - 1) * step_pixels);
        for (; x <= end; x += step_pixels) {
            const std::uint16_t *pixels = row + x;
            prefetch(pixels + width);
            if (x > 0) lefts = load(pixels - 1);
            const Codes first = encoder.encode(load(pixels), lefts, load(tops + x));
            const Codes second =
                encoder.encode(load(pixels + lanes16), load(pixels + lanes16 - 1), load(tops + x + lanes16));
            crc = checksum_step(crc, pixels);
            merger.merge(first, second, block);
        }
        block.append_to(writer);
    }
    if (x < width) {
        encode_rest(encoder, merger, block, row + x, tops + x, width - x);
        crc = checksum_rest(crc, row + x, width - x);
        block.append_to(writer);
    }
    writer.finish(bits);
    return static_cast<std::uint32_t>(crc);
}

std::uint32_t bits_in_use(const std::uint16_t *row, std::uint32_t width) {
    Lanes seen = zero();
    std::uint32_t x = 0, rest = 0;
    for (; x + lanes16 <= width; x += lanes16) seen = both(seen, load(row + x));
    for (; x < width; ++x) rest |= row[x];
    std::uint16_t each[lanes16];
    store(each, seen);
    for (const std::uint16_t bits : each) rest |= bits;
    return rest;
}

}  // namespace recorder::avx2
