#include "encode_avx2.hpp"

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

// Eight words fit 64 bits nearly always up to this many bits a pixel.
constexpr std::uint32_t eights_bits = 6;

template <bool eights>
std::uint32_t encode(BitWriter &bits, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth,
                     const KTable &table, std::uint32_t first_crc) {
    const PixelEncoder encoder(table, depth);
    const Appender appender(depth, eights);
    const std::uint16_t *tops = row - width;
    WordWriter writer(bits);
    std::uint64_t crc = first_crc;

    // In the first column the upper neighbour stands for the left one.
    Lanes lefts = choose(first_lane16(), load(tops), load(row - 1));
    std::uint32_t x = 0;
    for (;;) {
        const std::uint16_t *pixels = row + x;
        prefetch(pixels + width);
        const Codes first = encoder.encode(load(pixels), lefts, load(tops + x));
        const Codes second =
            encoder.encode(load(pixels + lanes16), load(pixels + lanes16 - 1), load(tops + x + lanes16));
        crc = checksum_step(crc, pixels);
        appender.append(writer, first, second);
        x += step_pixels;
        if (x + step_pixels > width) break;
        lefts = load(row + x - 1);
    }
    if (x < width) {
        // The rest of the row in a full step, with code words of no bits behind its end.
        const std::uint32_t count = width - x;
        std::uint16_t left_pixels[step_pixels] = {}, pixels[step_pixels] = {}, top_pixels[step_pixels] = {};
        std::uint16_t wanted[step_pixels] = {};
        std::memcpy(left_pixels, row + x - 1, count * sizeof *row);
        std::memcpy(pixels, row + x, count * sizeof *row);
        std::memcpy(top_pixels, tops + x, count * sizeof *row);
        std::memset(wanted, 0xFF, count * sizeof *row);
        Codes codes[2];
        for (std::uint32_t i = 0; i < 2; ++i) {
            const std::uint32_t at = i * lanes16;
            codes[i] = encoder.encode(load(pixels + at), load(left_pixels + at), load(top_pixels + at));
            codes[i] = {common(codes[i].values, load(wanted + at)), common(codes[i].lengths, load(wanted + at))};
        }
        appender.append(writer, codes[0], codes[1]);
        crc = checksum_rest(crc, row + x, count);
    }
    writer.finish(bits);
    return static_cast<std::uint32_t>(crc);
}

}  // namespace

std::uint32_t encode_row(BitWriter &writer, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth,
                         const KTable &table, std::uint32_t bits_expected, std::uint32_t crc) {
    return bits_expected < width * eights_bits ? encode<true>(writer, row, width, depth, table, crc)
                                               : encode<false>(writer, row, width, depth, table, crc);
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
