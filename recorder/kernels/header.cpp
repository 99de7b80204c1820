#include <cstring>

#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "stuffing.hpp"

namespace recorder {
namespace {

class Writer {
  public:
    explicit Writer(std::uint8_t *target) : begin_(target), cursor_(target) {}

    void put(std::uint32_t value, unsigned bytes) {
        for (; bytes > 0; --bytes, value >>= 8) *cursor_++ = static_cast<std::uint8_t>(value & 255u);
    }
    std::size_t size() const { return static_cast<std::size_t>(cursor_ - begin_); }

  private:
    std::uint8_t *begin_;
    std::uint8_t *cursor_;
};

// Reads the stuffed header byte by byte and keeps it unstuffed for its checksum.
class Reader {
  public:
    Reader(const std::uint8_t *data, std::size_t size) : data_(data), size_(size) {}

    std::uint32_t get(unsigned bytes) {
        field_ = position_;
        std::uint32_t value = 0;
        for (unsigned i = 0; i < bytes; ++i) value |= std::uint32_t{next()} << (8 * i);
        return value;
    }
    [[noreturn]] void fail(const char *what) const { throw FormatError{what, field_}; }
    std::uint32_t checksum() const { return crc32c(bytes_.data(), count_); }
    std::size_t position() const { return position_; }

  private:
    std::uint8_t next() {
        if (position_ >= size_) throw FormatError{"the header ends early", size_};
        const std::uint8_t byte = data_[position_++];
        if (byte == marker_prefix) {
            if (position_ >= size_) throw FormatError{"the header ends early", size_};
            if (data_[position_] != 0) throw FormatError{"FF that is not followed by 00", position_ - 1};
            ++position_;
        }
        bytes_[count_++] = byte;
        return byte;
    }

    const std::uint8_t *data_;
    std::size_t size_;
    std::size_t position_ = marker_size;
    std::size_t field_ = marker_size;
    std::size_t count_ = 0;
    std::array<std::uint8_t, header_fixed_size + largest_table + 4 * most_streams + 4> bytes_{};
};

std::uint64_t bytes_of_bits(std::uint64_t bits) { return (bits + 7) / 8; }

// Fewest and most bytes in which stream `s` can hold its pixels.
std::uint64_t fewest_bytes(const Header &h, std::uint32_t s) {
    return bytes_of_bits(h.pixels_of(s) * (h.model == Model::raw ? h.depth : 1u));
}
std::uint64_t most_bytes(const Header &h, std::uint32_t s) {
    return bytes_of_bits(h.pixels_of(s) * (h.model == Model::raw ? h.depth : longest_code(h.depth)));
}

}  // namespace

std::uint64_t Header::payload() const {
    std::uint64_t sum = 0;
    for (std::uint32_t s = 0; s < streams; ++s) sum += lengths[s];
    return sum;
}

std::size_t write_header(std::uint8_t *target, const Header &header) {
    Writer out(target);
    out.put(format_version, 1);
    out.put(static_cast<std::uint8_t>(header.model), 1);
    out.put(header.depth, 1);
    out.put(header.mask, 1);
    out.put(header.width, 4);
    out.put(header.height, 4);
    out.put(header.streams, 2);
    out.put(header.checksum, 4);
    std::array<std::uint8_t, largest_table> table;
    const std::size_t table_bytes = table_size(header.model);
    write_table(table.data(), header);
    out.put(static_cast<std::uint32_t>(table_bytes), 2);
    for (std::size_t i = 0; i < table_bytes; ++i) out.put(table[i], 1);
    for (std::uint32_t s = 0; s < header.streams; ++s) out.put(header.lengths[s], 4);
    out.put(crc32c(target, out.size()), 4);
    return out.size();
}

ParsedHeader parse_header(const std::uint8_t *data, std::size_t size) {
    if (size < marker_size || data[0] != marker_prefix || data[1] != start_of_image)
        throw FormatError{"no FF E8 at the start", 0};
    Reader in(data, size);
    Header header;

    // First what says how long the header is, then its checksum, then what it claims.
    if (in.get(1) != format_version) in.fail("unknown version");
    const std::uint32_t model = in.get(1);
    if (model > static_cast<std::uint32_t>(Model::felics_ls)) in.fail("unknown model");
    header.model = static_cast<Model>(model);
    header.depth = static_cast<std::uint8_t>(in.get(1));
    header.mask = static_cast<std::uint8_t>(in.get(1));
    header.width = in.get(4);
    header.height = in.get(4);
    header.streams = in.get(2);
    if (header.streams < 1 || header.streams > most_streams) in.fail("the number of streams is not 1 to 256");
    header.checksum = in.get(4);
    const std::size_t table_bytes = table_size(header.model);
    if (in.get(2) != table_bytes) in.fail("wrong table length for this model");
    std::array<std::uint8_t, largest_table> table;
    for (std::size_t i = 0; i < table_bytes; ++i) table[i] = static_cast<std::uint8_t>(in.get(1));
    read_table(header, table.data());
    for (std::uint32_t s = 0; s < header.streams; ++s) header.lengths[s] = in.get(4);
    const std::uint32_t computed = in.checksum();
    if (in.get(4) != computed) in.fail("the header's checksum is wrong");

    const auto refuse = [&](const char *what, std::size_t index) {
        throw FormatError{what, marker_size + stuffed_position(data + marker_size, size - marker_size, index)};
    };
    if (header.depth < 1 || header.depth > 16) refuse("the bit depth is not 1 to 16", 2);
    if (header.width < 1 || header.width > longest_side) refuse("the width is not 1 to 65535", 4);
    if (header.height < 1 || header.height > longest_side) refuse("the height is not 1 to 65535", 8);
    if (std::uint64_t{header.width} * header.height > most_pixels) refuse("more than 2^28 pixels", 4);
    if (header.model == Model::felics_ls && header.depth > deepest_ls) refuse("felics-ls is for 12 bits at most", 2);
    if (const std::size_t index = sound_table(header); index < table_bytes)
        refuse("a k or m above 15 or the bit depth", header_fixed_size + index);
    for (std::uint32_t s = 0; s < header.streams; ++s)
        if (header.lengths[s] < fewest_bytes(header, s) || header.lengths[s] > most_bytes(header, s))
            refuse("a stream length that cannot hold its pixels", header_fixed_size + table_bytes + 4 * s);
    return {header, in.position()};
}

ParsedHeader parse_image(const std::uint8_t *data, std::size_t size) {
    const ParsedHeader parsed = parse_header(data, size);
    if (size < parsed.end + marker_size || data[size - 2] != marker_prefix || data[size - 1] != end_of_image)
        throw FormatError{"no FF E9 at the end", size};
    if (parsed.header.payload() > size - marker_size - parsed.end)
        throw FormatError{"the streams are longer than the image", size};
    return parsed;
}

}  // namespace recorder
