// The marker-framed lossless image of docs/felics.md, without Python.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "code.hpp"
#include "model_ls.hpp"

namespace recorder {

constexpr std::uint8_t format_version = 1;
constexpr std::uint32_t longest_side = 65535;
constexpr std::uint64_t most_pixels = std::uint64_t{1} << 28;
constexpr std::uint32_t written_streams = 32;  // row y goes to stream y mod 32
constexpr std::uint32_t most_streams = 256;
constexpr std::size_t marker_size = 2;
constexpr std::size_t header_fixed_size = 20;  // version .. table length
constexpr std::size_t largest_table = ls_table_size;
constexpr std::size_t largest_written_header = header_fixed_size + largest_table + 4 * written_streams + 4;

// Makes FF the rarest byte in the payload of noisy 10-bit pictures (docs/felics.md, "Stuffing").
constexpr std::uint8_t usual_mask = 0x3C;

enum class Model : std::uint8_t { raw = 0, felics = 1, felics_ls = 2 };

// Bytes of a model's table in the header.
constexpr std::size_t table_size(Model model) {
    return model == Model::felics ? contexts : model == Model::felics_ls ? ls_table_size : 0;
}

struct Header {
    Model model = Model::felics;
    std::uint8_t depth = 10;
    std::uint8_t mask = usual_mask;
    std::uint32_t width = 0, height = 0;
    std::uint32_t streams = written_streams;
    std::uint32_t checksum = 0;  // CRC-32C of the pixels as little-endian uint16 in row order
    KTable table{};              // model felics only
    LsTable ls_table{};          // model felics-ls only
    std::array<std::uint32_t, most_streams> lengths{};

    // Bytes of the header itself, unstuffed.
    std::size_t size() const {
        return header_fixed_size + table_size(model) + 4u * streams + 4u;
    }
    // Rows that go to stream `s`.
    std::uint32_t rows_of(std::uint32_t s) const { return s < height ? (height - s + streams - 1) / streams : 0; }
    // Pixels that go to stream `s`.
    std::uint64_t pixels_of(std::uint32_t s) const { return std::uint64_t{rows_of(s)} * width; }
    // Bytes of all streams together.
    std::uint64_t payload() const;
};

struct ParsedHeader {
    Header header;
    std::size_t end;  // the byte of the image at which the payload begins
};

// Serialises `header` with its own checksum, unstuffed; returns header.size().
std::size_t write_header(std::uint8_t *target, const Header &header);

// Reads and checks the header of the image that begins at `data`; nothing behind it is looked at.
// Throws FormatError.
ParsedHeader parse_header(const std::uint8_t *data, std::size_t size);

// parse_header, and that `data` is one image from marker to marker whose streams could hold its
// pixels: what must be known before memory is taken for them. Throws FormatError.
ParsedHeader parse_image(const std::uint8_t *data, std::size_t size);

// How many bytes encode() may write for such an image.
std::size_t largest_encoding(std::uint32_t width, std::uint32_t height, std::uint32_t depth);

// A k for every context that suits photographs with sensor noise, never above `depth`.
KTable usual_table(std::uint32_t depth);

// The k that would have coded every 32nd row in the fewest bits, for each context; where a context
// does not occur there, the usual one.
KTable train_table(const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height, std::uint32_t depth);

// The least-squares weights, and the m and k of the fewest bits, on every 32nd row. Throws ArgumentError for
// a value above the depth; so does train_table for those that it sees.
LsTable train_ls_table(const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height, std::uint32_t depth);

// The header's table as its table_size() bytes, and back. sound_table is the index of the first byte that is
// out of range, or the size.
void write_table(std::uint8_t *target, const Header &header);
void read_table(Header &header, const std::uint8_t *bytes);
std::size_t sound_table(const Header &header);

// The model's table for this image, trained, into `header`, which has the model, shape and depth.
void train(Header &header, const std::uint16_t *pixels);

// Encodes height x width pixels into `target`, which has room for largest_encoding(). `table` is the model's
// table_size() bytes, or null: then it is trained. The model felics-ls is for deepest_ls bits at most.
// The rows are coded on `threads` threads, 1 to most_threads; the bytes are the same.
// Returns the bytes written. Throws ArgumentError for a value above the depth or a table out of range.
std::size_t encode(std::uint8_t *target, const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height,
                   std::uint32_t depth, Model model, const std::uint8_t *table, std::uint32_t threads = 1);

// Decodes an image into width * height pixels. Throws FormatError.
void decode(std::uint16_t *pixels, std::uint64_t count, const std::uint8_t *data, std::size_t size);

}  // namespace recorder
