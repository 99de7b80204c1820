#include "vector_set.hpp"

#include <algorithm>

#include "checksum_vector.hpp"
#include "code_vector.hpp"
#include "model_ls_vector.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

class LsPixelEncoder {
  public:
    LsPixelEncoder(const LsTable &table, std::uint32_t depth) : model_(table, depth), assembler_(depth) {}

    // `above_2` is the row two above.
    RECORDER_INLINE Codes encode(const std::uint16_t *line, const std::uint16_t *above,
                                 const std::uint16_t *above_2) const {
        const Lanes x = load(line);
        const LsLanes at = model_.apply(
            {load(line - 1), load(above), load(above - 1), load(above + 1), load(line - 2), load(above_2)});
        const Lanes size = powers_.power(at.m_twice), low = sub16(at.prediction, right16<1>(size));
        const Lanes inside = sub16(x, low), is_below = greater16(zero(), inside);
        // Below: -inside - 1. Above: inside - size, which is negative for what is inside.
        const Lanes distance = sub16(differing(inside, is_below), and_not(is_below, size));
        const Codes inside_code = {add16(size, inside), add16(common(at.m_twice, low_byte_), one_)};
        return assembler_.assemble(powers_, x, greater16(zero(), distance), inside_code,
                                   signed_max16(distance, zero()), add16(is_below, one_), at.k_twice);
    }

  private:
    Powers powers_;
    LsModel model_;
    CodeAssembler assembler_;
    Lanes one_ = kept(all16(1)), low_byte_ = kept(all16(0xFF));
};

}  // namespace

std::uint32_t encode_ls_row(BitWriter &bits, const LsLines &lines, const std::uint16_t *row, std::uint32_t width,
                            bool two_above, std::uint32_t depth, const LsTable &table, std::uint32_t first_crc) {
    const LsPixelEncoder encoder(table, depth);
    const Merger merger(depth);
    const std::uint16_t *line = lines.line(0), *above = lines.line(1), *above_2 = lines.line(two_above ? 2 : 1);
    WordWriter writer(bits);
    WordBlock block;
    std::uint64_t crc = first_crc;
    std::uint32_t x = 0;
    while (x + step_pixels <= width) {
        const std::uint32_t end = std::min(width - step_pixels, x + (WordBlock::steps - 1) * step_pixels);
        for (; x <= end; x += step_pixels) {
            prefetch_step(row + x + width);  // a row ahead
            crc = checksum_step(crc, line + x);
            const Codes first = encoder.encode(line + x, above + x, above_2 + x);
            const std::uint32_t next = x + lanes16;
            merger.merge(first, encoder.encode(line + next, above + next, above_2 + next), block);
        }
        block.append_to(writer);
    }
    if (x < width) {
        // The rest of the row in a full step, with code words of no bits behind its end.
        crc = checksum_rest(crc, line + x, width - x);
        Codes codes[2];
        for (std::uint32_t i = 0; i < 2; ++i, x += lanes16) {
            std::uint16_t wanted[lanes16] = {};
            if (x < width) std::fill_n(wanted, std::min(width - x, lanes16), std::uint16_t{0xFFFF});
            const Codes all = encoder.encode(line + x, above + x, above_2 + x);
            codes[i] = {common(all.values, load(wanted)), common(all.lengths, load(wanted))};
        }
        merger.merge(codes[0], codes[1], block);
        block.append_to(writer);
    }
    writer.finish(bits);
    return static_cast<std::uint32_t>(crc);
}

}  // namespace recorder::RECORDER_VECTOR
