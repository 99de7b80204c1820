#include <algorithm>
#include <cstring>

#include "cpu.hpp"
#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "parallel.hpp"
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

// The streams that one thread writes, and so the rows that it codes.
struct Share {
    std::uint32_t first, end;
};

// code(y) of every row of the share, from the top.
template <typename CodeRow>
void for_rows(Share share, const Header &header, CodeRow code) {
    for (std::uint32_t group = 0; group < header.height; group += written_streams)
        for (std::uint32_t y = group + share.first; y < std::min(group + share.end, header.height); ++y) code(y);
}

// The same with a checksum's register that code(y, crc) moves on over row y: the register of a picture whose
// other rows are zero. The exclusive or of all shares' is the picture's own.
template <typename CodeRow>
std::uint32_t for_rows_checked(Share share, const Header &header, CodeRow code) {
    const std::size_t row_bytes = std::size_t{header.width} * sizeof(std::uint16_t);
    const Crc32cZeros others((written_streams - (share.end - share.first)) * row_bytes);
    std::uint32_t crc = share.first == 0 ? crc32c_start : 0, next = share.first;
    for_rows(share, header, [&](std::uint32_t y) {
        if (y != next) crc = others.pass(crc);
        crc = code(y, crc);
        next = y + 1;
    });
    return next < header.height ? Crc32cZeros((header.height - next) * row_bytes).pass(crc) : crc;
}

void pack_rows(Writers &writers, const std::uint16_t *pixels, const Header &header, Share share) {
    for_rows(share, header, [&](std::uint32_t y) {
        pack_row(writers[y % written_streams], pixels + std::size_t{y} * header.width, header.width, header.depth);
    });
}

// Checks all pixels of the share, codes them by the model felics, and returns its part of the checksum's register:
// one pass over the memory.
std::uint32_t encode_rows(Writers &writers, const std::uint16_t *pixels, const Header &header, Share share) {
    const EncodeStretch encode_rest = has_wide() ? encode_stretch_wide : encode_stretch_anywhere;
    const VectorKernels *vectors = vector_kernels();
    const bool in_lanes = vectors != nullptr && header.depth <= deepest_encoded &&
                          header.width >= vectors->narrowest_encoded;
    const WideKTable table = widen(header.table);
    return for_rows_checked(share, header, [&](std::uint32_t y, std::uint32_t crc) {
        const std::uint16_t *row = pixels + std::size_t{y} * header.width;
        BitWriter &writer = writers[y % written_streams];
        check_row(row, header.width, header.depth);
        if (in_lanes && y > 0)
            return vectors->encode_row(writer, row, header.width, header.depth, header.table, crc);
        // In the topmost row the left neighbour stands for the upper one, and middle grey for both.
        const std::uint16_t *tops = y > 0 ? row - header.width + 1 : row;
        const std::uint32_t first = y > 0 ? tops[-1] : 1u << (header.depth - 1u);
        const Code code = encode_pixel(row[0], first, first, table.data(), header.depth);
        writer.append(code.value, code.length);
        encode_rest(writer, {row + 1, tops, header.width - 1}, table.data(), header.depth);
        return crc32c_update(crc, row, header.width * sizeof *row);
    });
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

// The same by the model felics-ls; `memory` has room for LsLines.
std::uint32_t encode_ls_rows(Writers &writers, const std::uint16_t *pixels, const Header &header, Share share,
                             std::uint16_t *memory) {
    const VectorKernels *vectors = vector_kernels();
    const bool in_lanes = vectors != nullptr && header.width >= vectors->narrowest_encoded;
    const auto row_of = [&](std::uint32_t y) { return pixels + std::size_t{y} * header.width; };
    LsLines lines(memory, in_lanes ? header.width : 0);
    const auto add = [&](std::uint32_t y) {
        lines.add(row_of(y), y > 0 ? *row_of(y - 1) : 1u << (header.depth - 1u));
    };
    std::uint32_t next = 0;  // the row below those in `lines`
    return for_rows_checked(share, header, [&](std::uint32_t y, std::uint32_t crc) {
        BitWriter &writer = writers[y % written_streams];
        check_row(row_of(y), header.width, header.depth);
        if (in_lanes) {
            for (next = std::max(next, y - std::min(y, 2u)); next <= y; ++next) add(next);
            if (y > 0)
                return vectors->encode_ls_row(writer, lines, row_of(y), header.width, y > 1, header.depth,
                                              header.ls_table, crc);
        }
        encode_ls_row(writer, row_of(y), y, header);
        return crc32c_update(crc, row_of(y), header.width * sizeof *pixels);
    });
}

// Codes by the header's model on so many threads, each of which writes streams of its own, and notes the checksum.
void encode_streams(Writers &writers, const std::uint16_t *pixels, Header &header, std::uint32_t threads) {
    thread_local Scratch<std::uint16_t> scratch;
    const std::size_t lines = LsLines::size(header.width);
    std::uint16_t *memory = header.model == Model::felics_ls ? scratch.reserve(threads * lines) : nullptr;
    std::array<std::uint32_t, written_streams> crcs{};
    in_parallel(threads, [&](std::uint32_t part) {
        const Share share = {written_streams * part / threads, written_streams * (part + 1) / threads};
        if (header.model == Model::raw) {
            pack_rows(writers, pixels, header, share);
        } else if (header.model == Model::felics_ls) {
            crcs[part] = encode_ls_rows(writers, pixels, header, share, memory + part * lines);
        } else {
            crcs[part] = encode_rows(writers, pixels, header, share);
        }
    });
    if (header.model == Model::raw) return;  // whose checksum is already there
    std::uint32_t crc = 0;
    for (const std::uint32_t part : crcs) crc ^= part;
    header.checksum = ~crc;
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
                   std::uint32_t depth, Model model, const std::uint8_t *table, std::uint32_t threads) {
    thread_local Scratch<std::uint8_t> scratch;
    const Trim trim(scratch);
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
        if (sound_table(header) < table_size(model)) throw ArgumentError{"a table with a k or m above 15 or the bit depth"};
    } else {
        train(header, pixels);
    }

    Payload payload{};
    for (;;) {
        payload.begins = lay_out(header, header.model == Model::raw ? depth : longest_code_of_any(depth));
        std::uint8_t *memory = scratch.reserve(payload.begins.back());
        payload.memory = memory;
        Writers writers;
        for (std::uint32_t s = 0; s < written_streams; ++s) writers[s] = BitWriter(memory + payload.begins[s]);
        encode_streams(writers, pixels, header, threads);
        for (std::uint32_t s = 0; s < written_streams; ++s)
            header.lengths[s] = static_cast<std::uint32_t>(writers[s].size());
        if (header.model == Model::raw || header.payload() + table_size(header.model) <= packed_size(header)) break;
        header.model = Model::raw;  // noise: the samples as they are need less
    }
    return frame(target, header, payload);
}

}  // namespace recorder
