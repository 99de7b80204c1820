#include "vector_set.hpp"

#include <algorithm>
#include <cstring>

#include "checksum_vector.hpp"
#include "code_vector.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

// encode_pixel of code.hpp. Numbers with "_twice" hold the same byte twice, as table indices do.
class PixelEncoder {
  public:
    PixelEncoder(const KTable &table, std::uint32_t depth) : assembler_(depth), k_(kept(table16(table.data()))) {}

    RECORDER_INLINE Codes encode(Lanes x, Lanes left, Lanes top) const {
        const Lanes low = min16(left, top), high = max16(left, top);
        const Lanes size = add16(sub16(high, low), one_);
        const Lanes context_twice = powers_.log2_twice(size), power = powers_.power(context_twice);

        // Inside: the prefix and v, or one bit more and v + t.
        const Lanes short_codes = sub16(add16(power, power), size);
        const Lanes inside = sub16(x, low);
        const Lanes is_short = greater16(short_codes, inside);
        const Codes inside_code = {
            add16(add16(power, inside), and_not(is_short, add16(power, short_codes))),
            add16(add16(common(context_twice, low_byte_), is_short), two_)};

        const Lanes beyond = both(monus16(low, x), monus16(x, high));
        return assembler_.assemble(powers_, x, equal16(beyond, zero()), inside_code, monus16(beyond, one_),
                                   sub16(zero(), greater16(x, high)), look_up(k_, context_twice));
    }

  private:
    Powers powers_;
    CodeAssembler assembler_;
    Lanes k_;
    Lanes one_ = kept(all16(1)), two_ = kept(all16(2)), low_byte_ = kept(all16(0xFF));
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
            prefetch_step(pixels + width);
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

void pack_row(BitWriter &bits, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth) {
    const Merger merger(depth);
    const Lanes lengths = all16(depth);
    BitWriter scalar = bits;
    WordWriter writer(bits);
    WordBlock block;
    std::uint32_t x = 0;
    while (x + step_pixels <= width) {
        const std::uint32_t end = std::min(width - step_pixels, x + (WordBlock::steps - 1) * step_pixels);
        for (; x <= end; x += step_pixels) {
            prefetch_step(row + x + width);
            merger.merge({load(row + x), lengths}, {load(row + x + lanes16), lengths}, block);
        }
        block.append_to(writer);
    }
    writer.finish(scalar);
    for (; x < width; ++x) scalar.append(row[x], depth);
    bits = scalar;
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

}  // namespace recorder::RECORDER_VECTOR
