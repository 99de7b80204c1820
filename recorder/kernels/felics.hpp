// The marker-framed lossless image of docs/felics.md, without Python.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "code.hpp"

namespace recorder {

constexpr std::uint8_t format_version = 1;
constexpr std::uint32_t longest_side = 65535;
constexpr std::uint64_t most_pixels = std::uint64_t{1} << 28;
constexpr std::uint32_t written_streams = 32;  // row y goes to stream y mod 32
constexpr std::uint32_t most_streams = 256;
constexpr std::size_t marker_size = 2;
constexpr std::size_t header_fixed_size = 20;  // version .. table length
constexpr std::size_t largest_written_header = header_fixed_size + contexts + 4 * written_streams + 4;

// Makes FF the rarest byte in the payload of noisy 10-bit pictures (docs/felics.md, "Stuffing").
constexpr std::uint8_t usual_mask = 0x3C;

enum class Model : std::uint8_t { raw = 0, felics = 1 };

struct Header {
    Model model = Model::felics;
    std::uint8_t depth = 10;
    std::uint8_t mask = usual_mask;
    std::uint32_t width = 0, height = 0;
    std::uint32_t streams = written_streams;
    std::uint32_t checksum = 0;  // CRC-32C of the pixels as little-endian uint16 in row order
    KTable table{};              // model felics only
    std::array<std::uint32_t, most_streams> lengths{};

    // Bytes of the header itself, unstuffed.
    std::size_t size() const {
        return header_fixed_size + (model == Model::felics ? contexts : 0u) + 4u * streams + 4u;
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

// Encodes height x width pixels into `target`, which has room for largest_encoding(). `table` may be
// null: then it is trained. Returns the bytes written. Throws ArgumentError for a value above the depth.
std::size_t encode(std::uint8_t *target, const std::uint16_t *pixels, std::uint32_t width, std::uint32_t height,
                   std::uint32_t depth, Model model, const KTable *table);

// Decodes an image into width * height pixels. Throws FormatError.
void decode(std::uint16_t *pixels, std::uint64_t count, const std::uint8_t *data, std::size_t size);

}  // namespace recorder
