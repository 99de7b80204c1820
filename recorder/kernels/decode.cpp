#include <cstring>

#include "cpu.hpp"
#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "scratch.hpp"
#include "stuffing.hpp"
#include "vector_kernels.hpp"

namespace recorder {
namespace {

constexpr std::size_t load_slack = 8;  // peek() loads 8 bytes at a time

// Where a stream is read and where it ends, both in bits of the unstuffed payload.
struct Cursor {
    std::size_t bit = 0;
    std::size_t end = 0;
};

// What all rows are read from; no bytes in it, which the pixels could be taken to overwrite.
struct Source {
    const std::uint8_t *payload;
    std::uint32_t depth;
    std::uint32_t width;
    WideKTable table;
};

// One row being decoded: its stream, its pixels, and what one step leaves for the next.
struct Row {
    std::uint16_t *pixels;
    const std::uint16_t *tops;  // the upper neighbours of pixels[1], pixels[2] and so on
    std::size_t bit;
    std::uint32_t left = 0;
    std::uint32_t wrong = 0;

    // In the topmost row the left neighbour stands for the upper one.
    Row(std::uint16_t *image, std::uint32_t y, const Header &h, const Cursor &cursor)
        : pixels(image + std::size_t{y} * h.width),
          tops(y > 0 ? pixels - h.width + 1 : pixels),
          bit(cursor.bit) {}

    [[gnu::always_inline]] void step(const Source &from, std::uint32_t x, std::uint32_t top) {
        const Decoded pixel = decode_pixel(peek(from.payload, bit), left, top, from.table.data(), from.depth);
        left = pixel.value & 0xFFFFu;
        pixels[x] = static_cast<std::uint16_t>(left);
        bit += pixel.length;
        wrong |= pixel.wrong;
    }
    // The first pixel: `first` stands for both neighbours.
    [[gnu::always_inline]] void start(const Source &from, std::uint32_t first) {
        left = first;
        step(from, 0, first);
    }
};

// Two rows of different streams; the lower follows one pixel behind the upper, so that the latency of
// one is spent on the other.
[[gnu::always_inline]] inline void decode_pair(Row &upper_row, Row &lower_row, const Source &from,
                                               std::uint32_t first) {
    Row upper = upper_row, lower = lower_row;
    upper.start(from, first);
    std::uint32_t top = upper.left;
    if (from.width > 1) {
        upper.step(from, 1, upper.tops[0]);
        lower.start(from, top);
        for (std::uint32_t x = 2; x < from.width; ++x) {
            top = upper.left;
            upper.step(from, x, upper.tops[x - 1]);
            lower.step(from, x - 1, top);
        }
        lower.step(from, from.width - 1, upper.left);
    } else {
        lower.start(from, top);
    }
    upper_row = upper;
    lower_row = lower;
}

using DecodePair = void (*)(Row &, Row &, const Source &, std::uint32_t);

void decode_pair_anywhere(Row &upper, Row &lower, const Source &source, std::uint32_t first) {
    decode_pair(upper, lower, source, first);
}

RECORDER_WIDE void decode_pair_wide(Row &upper, Row &lower, const Source &source, std::uint32_t first) {
    decode_pair(upper, lower, source, first);
}

class Decoder {
  public:
    Decoder(std::uint16_t *image, const std::uint8_t *payload, const Header &header)
        : image_(image),
          payload_(payload),
          h_(header),
          source_{payload, header.depth, header.width, widen(header.table)} {
        std::size_t byte = 0;
        for (std::uint32_t s = 0; s < h_.streams; ++s) {
            cursors_[s].bit = byte * 8;
            byte += h_.lengths[s];
            cursors_[s].end = byte * 8;
        }
    }

    void run() {
        if (const VectorKernels *vectors = vector_kernels(); vectors != nullptr) {
            if (vectors->decodes(h_) && decode_wave(vectors->decode_rows)) return;
            if (vectors->decodes_ls(h_) && decode_wave(vectors->decode_ls_rows)) return;
        }
        if (h_.model == Model::raw) {
            for (std::uint32_t y = 0; y < h_.height; ++y) unpack_row(y);
        } else if (h_.model == Model::felics_ls) {
            for (std::uint32_t y = 0; y < h_.height; ++y) decode_ls_row(y);
        } else {
            decode_one(0);
            std::uint32_t y = 1;
            if (h_.streams > 1)
                for (; y + 1 < h_.height; y += 2) decode_two(y);
            for (; y < h_.height; ++y) decode_one(y);
        }
        for (std::uint32_t s = 0; s < h_.streams; ++s) check_end(cursors_[s]);
    }

  private:
    Cursor &cursor_of(std::uint32_t y) { return cursors_[y % h_.streams]; }

    std::uint32_t first_of(const Row &row, std::uint32_t y) const {
        return y > 0 ? row.tops[-1] : 1u << (h_.depth - 1u);
    }

    // False if the image is broken: then decoding row by row tells where.
    bool decode_wave(DecodeRows *decode_rows) {
        thread_local Scratch<std::uint16_t> scratch;
        const std::array<Cursor, most_streams> before = cursors_;
        if (h_.model == Model::felics_ls) {
            decode_ls_row(0);
        } else {
            decode_one(0);
        }
        StreamEnds streams[written_streams];
        for (std::uint32_t s = 0; s < written_streams; ++s)
            streams[s] = {static_cast<std::uint32_t>(cursors_[s].bit), static_cast<std::uint32_t>(cursors_[s].end)};
        if (decode_rows(image_, scratch.reserve(h_.width), payload_, h_, streams)) {
            for (std::uint32_t s = 0; s < written_streams; ++s) cursors_[s].bit = streams[s].bit;
            for (std::uint32_t s = 0; s < written_streams; ++s) check_end(cursors_[s]);
            return true;
        }
        cursors_ = before;
        return false;
    }

    void unpack_row(std::uint32_t y) {
        Cursor &cursor = cursor_of(y);  // its length was checked with the header: it holds all its rows
        std::uint16_t *row = image_ + std::size_t{y} * h_.width;
        std::size_t bit = cursor.bit;
        for (std::uint32_t x = 0; x < h_.width; ++x, bit += h_.depth)
            row[x] = static_cast<std::uint16_t>(peek(payload_, bit) >> (64u - h_.depth));
        cursor.bit = bit;
    }

    void decode_ls_row(std::uint32_t y) {
        Cursor &cursor = cursor_of(y);
        std::uint16_t *row = image_ + std::size_t{y} * h_.width;
        const std::uint16_t *above = y > 0 ? row - h_.width : row;
        const std::uint32_t middle = 1u << (h_.depth - 1u);
        for (std::uint32_t x = 0; x < h_.width; ++x) {
            const Neighbours n = y == 0 ? Neighbours(row, middle, x)
                                        : Neighbours(row, above, y > 1 ? above - h_.width : above,
                                                     y > 1 ? *(above - h_.width) : middle, h_.width, x);
            const Decoded pixel =
                decode_ls_pixel(peek(payload_, cursor.bit), LsInterval(n, h_.ls_table, h_.depth), h_.depth);
            if (cursor.bit + pixel.length > cursor.end) throw FormatError{"a stream ends early", cursor.end / 8};
            if (pixel.wrong != 0) throw FormatError{"a code that means no pixel", cursor.bit / 8};
            cursor.bit += pixel.length;
            row[x] = static_cast<std::uint16_t>(pixel.value);
        }
    }

    void decode_one(std::uint32_t y) {
        Row row(image_, y, h_, cursor_of(y));
        row.start(source_, first_of(row, y));
        for (std::uint32_t x = 1; x < h_.width; ++x) row.step(source_, x, row.tops[x - 1]);
        finish(row, y);
    }

    void decode_two(std::uint32_t y) {
        Row upper(image_, y, h_, cursor_of(y)), lower(image_, y + 1, h_, cursor_of(y + 1));
        decode_pair_(upper, lower, source_, first_of(upper, y));
        finish(upper, y);
        finish(lower, y + 1);
    }

    // A row may have read beyond its stream, never beyond the padded payload: look only now.
    void finish(const Row &row, std::uint32_t y) {
        Cursor &cursor = cursor_of(y);
        if (row.wrong != 0 || row.bit > cursor.end) explain(y);
        cursor.bit = row.bit;
    }

    // Decodes a broken row once more, slowly, to name the byte.
    [[noreturn]] void explain(std::uint32_t y) {
        const Cursor &cursor = cursor_of(y);
        Row row(image_, y, h_, cursor);
        row.left = first_of(row, y);
        for (std::uint32_t x = 0; x < h_.width; ++x) {
            const std::size_t before = row.bit;
            row.step(source_, x, x > 0 ? row.tops[x - 1] : row.left);
            if (row.bit > cursor.end) throw FormatError{"a stream ends early", cursor.end / 8};
            if (row.wrong != 0) throw FormatError{"a code that means no pixel", before / 8};
        }
        throw FormatError{"a row that cannot be read", cursor.bit / 8};
    }

    void check_end(const Cursor &cursor) const {
        if (cursor.end - cursor.bit >= 8) throw FormatError{"bytes are left over in a stream", (cursor.bit + 7) / 8};
        const std::uint64_t padding = cursor.end - cursor.bit;
        if (padding != 0 && (peek(payload_, cursor.bit) >> (64u - padding)) != 0)
            throw FormatError{"a stream is padded with ones", cursor.bit / 8};
    }

    std::uint16_t *image_;
    const std::uint8_t *payload_;
    const Header &h_;
    const Source source_;
    const DecodePair decode_pair_ = has_wide() ? decode_pair_wide : decode_pair_anywhere;
    std::array<Cursor, most_streams> cursors_;
};

}  // namespace

void decode(std::uint16_t *pixels, std::uint64_t count, const std::uint8_t *data, std::size_t size) {
    thread_local Scratch<std::uint8_t> scratch;
    const ParsedHeader parsed = parse_image(data, size);
    const Header &header = parsed.header;
    if (count != std::uint64_t{header.width} * header.height) throw ArgumentError{"the output has another size"};

    // No row can read further beyond its stream than its longest codes: then rows need no checks inside.
    const std::size_t overrun = std::size_t{header.width} * longest_code(header.depth) / 8 + load_slack + 1;
    const std::uint8_t *stuffed = data + parsed.end;
    const std::size_t stuffed_size = size - marker_size - parsed.end;
    std::uint8_t *payload = scratch.reserve(stuffed_size + overrun);
    const std::size_t payload_size = unstuff(payload, stuffed, stuffed_size, header.mask, parsed.end);
    if (payload_size < header.payload()) throw FormatError{"the streams are longer than the image", size - marker_size};
    if (payload_size > header.payload())
        throw FormatError{"bytes are left over behind the streams",
                          parsed.end + stuffed_position(stuffed, stuffed_size, header.payload())};
    std::memset(payload + payload_size, 0, overrun);

    try {
        Decoder(pixels, payload, header).run();
    } catch (const FormatError &error) {
        throw FormatError{error.what, parsed.end + stuffed_position(stuffed, stuffed_size, error.offset)};
    }
    if (crc32c(pixels, static_cast<std::size_t>(count) * sizeof *pixels) != header.checksum)
        throw FormatError{"the pixels' checksum is wrong", size - marker_size};
    scratch.trim();
}

}  // namespace recorder
