#include <algorithm>
#include <cstring>

#include "cpu.hpp"
#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "rows.hpp"
#include "scratch.hpp"
#include "stuffing.hpp"
#include "vector_kernels.hpp"

namespace recorder {
namespace {

constexpr std::size_t store_slack = 8;  // BitWriter stores 8 bytes at a time
using Writers = std::array<BitWriter, written_streams>;

std::uint64_t packed_size(const Header &header) {
    std::uint64_t sum = 0;
    for (std::uint32_t s = 0; s < header.streams; ++s) sum += (header.pixels_of(s) * header.depth + 7) / 8;
    return sum;
}

// Room for each stream at `bits` per pixel, one after another; returns where each begins.
std::array<std::size_t, written_streams + 1> lay_out(const Header &header, std::uint32_t bits) {
    std::array<std::size_t, written_streams + 1> begins{};
    for (std::uint32_t s = 0; s < written_streams; ++s)
        begins[s + 1] = begins[s] + static_cast<std::size_t>((header.pixels_of(s) * bits + 7) / 8) + store_slack;
    return begins;
}

// One row of the model felics but for its first pixel: row[-1] is that, tops[i] stands above row[i].
struct Stretch {
    const std::uint16_t *row;
    const std::uint16_t *tops;
    std::uint32_t count;
};

// Codes a stretch block by block: first all codes of a block, which no code waits for (the compiler
// makes vector instructions of it where the processor has shifts by a vector), then appends them, two
// at a time because appending is the one serial chain.
[[gnu::always_inline]] inline void encode_stretch(BitWriter &writer, const Stretch &stretch,
                                                  const std::uint32_t *__restrict table, std::uint32_t depth) {
    constexpr std::uint32_t block = 256;  // 2 KB of codes: stays in the nearest cache
    std::uint32_t values[block], lengths[block];
    BitWriter out = writer;
    for (std::uint32_t begin = 0; begin < stretch.count; begin += block) {
        const std::uint32_t count = std::min(block, stretch.count - begin);
        const std::uint16_t *row = stretch.row + begin, *lefts = row - 1, *tops = stretch.tops + begin;
        for (std::uint32_t i = 0; i < count; ++i) {
            const Code code = encode_pixel(row[i], lefts[i], tops[i], table, depth);
            values[i] = code.value;
            lengths[i] = code.length;
        }
        std::uint32_t i = 0;
        for (; i + 1 < count; i += 2)
            out.append((std::uint64_t{values[i]} << lengths[i + 1]) | values[i + 1], lengths[i] + lengths[i + 1]);
        if (i < count) out.append(values[i], lengths[i]);
    }
    writer = out;
}

using EncodeStretch = void (*)(BitWriter &, const Stretch &, const std::uint32_t *, std::uint32_t);

void encode_stretch_anywhere(BitWriter &writer, const Stretch &stretch, const std::uint32_t *table,
                             std::uint32_t depth) {
    encode_stretch(writer, stretch, table, depth);
}

RECORDER_WIDE void encode_stretch_wide(BitWriter &writer, const Stretch &stretch, const std::uint32_t *table,
                                       std::uint32_t depth) {
    encode_stretch(writer, stretch, table, depth);
}

void pack_row(BitWriter &writer, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth) {
    if (const VectorKernels *vectors = vector_kernels(); vectors != nullptr && depth <= deepest_encoded) {
        vectors->pack_row(writer, row, width, depth);
        return;
    }
    BitWriter out = writer;
    for (std::uint32_t x = 0; x < width; ++x) out.append(row[x], depth);
    writer = out;
}

void pack_rows(Writers &writers, const std::uint16_t *pixels, const Header &header) {
    for (std::uint32_t y = 0; y < header.height; ++y)
        pack_row(writers[y % written_streams], pixels + std::size_t{y} * header.width, header.width, header.depth);
}

// Checks all pixels, codes them by the model felics, and notes their checksum: one pass over the memory.
void encode_rows(Writers &writers, const std::uint16_t *pixels, Header &header) {
    const EncodeStretch encode_rest = has_wide() ? encode_stretch_wide : encode_stretch_anywhere;
    const VectorKernels *vectors = vector_kernels();
    const bool in_lanes = vectors != nullptr && header.depth <= deepest_encoded &&
                          header.width >= vectors->narrowest_encoded;
    const WideKTable table = widen(header.table);
    std::uint32_t crc = crc32c_start;
    for (std::uint32_t y = 0; y < header.height; ++y) {
        const std::uint16_t *row = pixels + std::size_t{y} * header.width;
        BitWriter &writer = writers[y % written_streams];
        check_row(row, header.width, header.depth);
        if (in_lanes && y > 0) {
            crc = vectors->encode_row(writer, row, header.width, header.depth, header.table, crc);
            continue;
        }
        // In the topmost row the left neighbour stands for the upper one, and middle grey for both.
        const std::uint16_t *tops = y > 0 ? row - header.width + 1 : row;
        const std::uint32_t first = y > 0 ? tops[-1] : 1u << (header.depth - 1u);
        const Code code = encode_pixel(row[0], first, first, table.data(), header.depth);
        writer.append(code.value, code.length);
        encode_rest(writer, {row + 1, tops, header.width - 1}, table.data(), header.depth);
        crc = crc32c_update(crc, row, header.width * sizeof *row);
    }
    header.checksum = ~crc;
}

void encode_ls_row(BitWriter &writer, const std::uint16_t *row, std::uint32_t y, const Header &header) {
    const std::uint32_t width = header.width, middle = 1u << (header.depth - 1u);
    const std::uint16_t *above = y > 0 ? row - width : row, *above_2 = y > 1 ? above - width : above;
    const std::uint32_t corner = y > 1 ? above_2[0] : middle;
    for (std::uint32_t x = 0; x < width; ++x) {
        const Neighbours n =
            y == 0 ? Neighbours(row, middle, x) : Neighbours(row, above, above_2, corner, width, x);
        const Code code = encode_ls_pixel(row[x], LsInterval(n, header.ls_table, header.depth), header.depth);
        writer.append(code.value, code.length);
    }
}

// The same by the model felics-ls: `encode_row(row, y, crc)` appends a row and moves the checksum on.
template <typename EncodeRow>
void encode_ls_rows(const std::uint16_t *pixels, Header &header, EncodeRow encode_row) {
    std::uint32_t crc = crc32c_start;
    for (std::uint32_t y = 0; y < header.height; ++y) {
        const std::uint16_t *row = pixels + std::size_t{y} * header.width;
        check_row(row, header.width, header.depth);
        crc = encode_row(row, y, crc);
    }
    header.checksum = ~crc;
}

void encode_ls(Writers &writers, const std::uint16_t *pixels, Header &header) {
    const auto scalar = [&](const std::uint16_t *row, std::uint32_t y, std::uint32_t crc) {
        encode_ls_row(writers[y % written_streams], row, y, header);
        return crc32c_update(crc, row, header.width * sizeof *row);
    };
    const VectorKernels *vectors = vector_kernels();
    if (vectors == nullptr || header.width < vectors->narrowest_encoded) {
        encode_ls_rows(pixels, header, scalar);
        return;
    }
    thread_local Scratch<std::uint16_t> scratch;
    LsLines lines(scratch.reserve(LsLines::size(header.width)), header.width);
    encode_ls_rows(pixels, header, [&](const std::uint16_t *row, std::uint32_t y, std::uint32_t crc) {
        lines.add(row, y > 0 ? *(row - header.width) : 1u << (header.depth - 1u));
        if (y == 0) return scalar(row, y, crc);
        return vectors->encode_ls_row(writers[y % written_streams], lines, row, header.width, y > 1, header.depth,
                                      header.ls_table, crc);
    });
}

// The bytes of all streams, where each was written.
struct Payload {
    const std::uint8_t *memory;
    std::array<std::size_t, written_streams + 1> begins;
};

// The mask that turns the rarest byte of the payload into FF: at most one byte in 256 is stuffed.
std::uint8_t rarest_mask(const Payload &payload, const Header &header) {
    std::array<std::size_t, 256> counts{};
    for (std::uint32_t s = 0; s < written_streams; ++s)
        for (std::size_t i = 0; i < header.lengths[s]; ++i) ++counts[payload.memory[payload.begins[s] + i]];
    const auto rarest = std::min_element(counts.begin(), counts.end()) - counts.begin();
    return static_cast<std::uint8_t>(rarest ^ marker_prefix);
}

std::size_t frame(std::uint8_t *target, Header &header, const Payload &payload) {
    const auto fill = [&](std::uint8_t mask, std::size_t extra) -> std::size_t {
        std::array<std::uint8_t, largest_written_header> plain;
        std::uint8_t *out = target;
        header.mask = mask;
        *out++ = marker_prefix;
        *out++ = start_of_image;
        std::size_t extra_in_header = plain.size();
        stuff(out, plain.data(), write_header(plain.data(), header), 0, extra_in_header);
        for (std::uint32_t s = 0; s < written_streams; ++s)
            if (!stuff(out, payload.memory + payload.begins[s], header.lengths[s], mask, extra)) return 0;
        *out++ = marker_prefix;
        *out++ = end_of_image;
        return static_cast<std::size_t>(out - target);
    };
    // The usual mask costs 0.3 % (docs/felics.md); a picture that it does not suit is counted.
    const std::size_t size = header.payload();
    const std::size_t written = fill(usual_mask, size / 128);
    return written != 0 ? written : fill(rarest_mask(payload, header), size / 256);
}

}  // namespace

void check_row(const std::uint16_t *row, std::uint32_t width, std::uint32_t depth) {
    std::uint32_t seen = 0;
    if (const VectorKernels *vectors = vector_kernels(); vectors != nullptr) {
        seen = vectors->bits_in_use(row, width);
    } else {
        for (std::uint32_t x = 0; x < width; ++x) seen |= row[x];
    }
    if ((seen >> depth) != 0) throw ArgumentError{"a pixel value above the bit depth"};
}

std::size_t largest_encoding(std::uint32_t width, std::uint32_t height, std::uint32_t depth) {
    const std::uint64_t pixels = std::uint64_t{width} * height;
    const std::uint64_t payload = (pixels * depth + 7) / 8 + written_streams;  // each stream is padded
    return static_cast<std::size_t>(2 * marker_size + 2 * largest_written_header + payload + payload / 128);
}

std::size_t encode(std::uint8_t *target, const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height,
                   std::uint32_t depth, Model model, const std::uint8_t *table) {
    thread_local Scratch<std::uint8_t> scratch;
    Header header;
    header.model = model;
    header.depth = static_cast<std::uint8_t>(depth);
    header.width = width;
    header.height = height;
    if (model == Model::raw) {
        for (std::uint32_t y = 0; y < height; ++y) check_row(pixels + std::size_t{y} * width, width, depth);
        header.checksum = crc32c(pixels, std::size_t{width} * height * sizeof *pixels);
    } else if (table != nullptr) {
        read_table(header, table);
        if (sound_table(header) < table_size(model)) throw ArgumentError{"k is 0 to 15 and at most the bit depth"};
    } else {
        train(header, pixels);
    }

    Payload payload{};
    for (;;) {
        payload.begins = lay_out(header, header.model == Model::raw ? depth : longest_code(depth));
        std::uint8_t *memory = scratch.reserve(payload.begins.back());
        payload.memory = memory;
        Writers writers;
        for (std::uint32_t s = 0; s < written_streams; ++s) writers[s] = BitWriter(memory + payload.begins[s]);
        if (header.model == Model::raw) {
            pack_rows(writers, pixels, header);
        } else if (header.model == Model::felics_ls) {
            encode_ls(writers, pixels, header);
        } else {
            encode_rows(writers, pixels, header);
        }
        for (std::uint32_t s = 0; s < written_streams; ++s)
            header.lengths[s] = static_cast<std::uint32_t>(writers[s].size());
        if (header.model == Model::raw || header.payload() + table_size(header.model) <= packed_size(header)) break;
        header.model = Model::raw;  // noise: the samples as they are need less
    }
    const std::size_t written = frame(target, header, payload);
    scratch.trim();
    return written;
}

}  // namespace recorder
