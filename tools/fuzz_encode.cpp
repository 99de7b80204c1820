// libFuzzer target: any picture, encoded, is the image that docs/felics.md promises and decodes to itself.
#include "crc32c.hpp"
#include "fuzz.hpp"
#include "unpack.hpp"

using namespace recorder;

namespace {

// Numbers from the fuzzer's bytes, and from these once more when they are used up.
class Source {
  public:
    Source(const std::uint8_t *data, std::size_t size) : data_(data), size_(size) {}

    std::uint32_t byte() { return size_ == 0 ? 0 : data_[at_++ % size_]; }
    std::uint32_t below(std::uint32_t limit) {
        const std::uint32_t high = byte();
        return (high << 8 | byte()) % limit;
    }

  private:
    const std::uint8_t *data_;
    std::size_t size_, at_ = 0;
};

enum class Content { levels, along_rows, along_columns, between, kinds };

std::vector<std::uint16_t> picture(Source &source, std::uint32_t width, std::uint32_t height, std::uint32_t depth) {
    const std::uint32_t top = (1u << depth) - 1u;
    const auto content = static_cast<Content>(source.below(static_cast<std::uint32_t>(Content::kinds)));
    const std::uint32_t spread = source.below(top + 1u) + 1u;  // of the differences
    std::vector<std::uint16_t> pixels(std::size_t{width} * height);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
        const std::uint32_t left = i > 0 ? pixels[i - 1] : top / 2u, above = i >= width ? pixels[i - width] : left;
        const std::uint32_t base = content == Content::along_rows      ? left
                                   : content == Content::along_columns ? above
                                                                       : (left + above) / 2u;
        const std::uint32_t near = std::min(base + source.below(spread) - std::min(base, spread / 2u), top);
        pixels[i] = static_cast<std::uint16_t>(content == Content::levels ? source.below(top + 1u) : near);
    }
    return pixels;
}

void check_frame(const Bytes &image, const std::vector<std::uint16_t> &pixels, Model model, const std::uint8_t *table) {
    const ParsedHeader parsed = parse_image(image.data(), image.size());
    const Header &header = parsed.header;
    require(header.model == model || header.model == Model::raw, "the model is the wanted one, or raw");
    require(header.checksum == crc32c_portable(pixels.data(), 2 * pixels.size()), "the pixels' checksum is theirs");
    if (header.model == model && table != nullptr) {
        Bytes written(table_size(model));
        write_table(written.data(), header);
        require(std::equal(written.begin(), written.end(), table), "the header has the table that was given");
    }

    std::uint64_t packed = 0;
    for (std::uint32_t s = 0; s < header.streams; ++s) packed += (header.pixels_of(s) * header.depth + 7) / 8;
    require(header.payload() + table_size(header.model) <= packed, "never larger than the packed pixels");
    const std::size_t stuffed = image.size() - marker_size - parsed.end;
    require(stuffed - header.payload() <= header.payload() / 128, "stuffing takes at most one byte in 128");

    const std::size_t end = image.size() - marker_size;
    for (std::size_t i = marker_size; i < end; ++i)
        require(image[i] != marker_prefix || image[i + 1] == 0, "inside, every FF is followed by 00");
    require(with_every_set("all sets find alike", [&] { return next_marker(image.data(), image.size(), 1); }) == end,
            "no marker stands inside");
}

void check_training(const std::vector<std::uint16_t> &pixels, std::uint32_t width, std::uint32_t height,
                    std::uint32_t depth, Model model) {
    const auto source = exact(pixels.data(), pixels.size());
    const Bytes table = with_every_set("all sets train alike", [&] {
        Header header;
        header.model = model;
        header.width = width;
        header.height = height;
        header.depth = static_cast<std::uint8_t>(depth);
        train(header, source.get());
        require(sound_table(header) == table_size(model), "a trained table is sound");
        Bytes bytes(table_size(model));
        write_table(bytes.data(), header);
        return bytes;
    });
    require(encode_with_every_set(pixels, width, height, depth, model, table.data()) ==
                encode_with_every_set(pixels, width, height, depth, model, nullptr),
            "encoding without a table is encoding with the trained one");
}

void check_unpacking(const std::uint8_t *data, std::size_t size) {
    const std::size_t count = 8 * size / 10;
    const auto packed = exact(data, (10 * count + 7) / 8);
    const std::unique_ptr<std::uint16_t[]> pixels(new std::uint16_t[count]);
    unpack_mono10p(pixels.get(), count, packed.get());
    for (std::size_t i = 0; i < count; ++i) {
        std::uint32_t level = 0;
        for (std::size_t bit = 10 * i; bit < 10 * i + 10; ++bit)
            level |= (data[bit / 8] >> (bit % 8) & 1u) << (bit - 10 * i);
        require(pixels[i] == level, "ten bits a pixel, the lowest first");
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
    check_unpacking(data, size);
    Source source(data, size);
    const auto model = static_cast<Model>(source.below(3));
    const std::uint32_t depth = 1u + source.below(model == Model::felics_ls ? deepest_ls : 16);
    std::uint32_t width = 1u + source.below(source.below(8) == 0 ? 1300 : 140);
    if (source.below(8) == 0) width = (width + 63) / 64 * 64;  // as cameras have it
    const std::uint32_t height = 1u + source.below(70);
    Bytes table(table_size(model));
    const bool trained = source.below(8) == 0, sound = source.below(8) != 0;
    for (std::size_t i = 0; i < table.size(); ++i) {
        const std::uint32_t limit = std::min(depth, 15u) + 1u;
        table[i] = static_cast<std::uint8_t>(source.byte());
        if (!sound || trained) continue;
        if (model == Model::felics) table[i] = static_cast<std::uint8_t>(table[i] % limit);
        if (model == Model::felics_ls && i < ls_contexts)
            table[i] = static_cast<std::uint8_t>(table[i] % limit | (table[i] >> 4) % limit << 4);
    }
    const std::uint8_t *given = trained ? nullptr : table.data();
    std::vector<std::uint16_t> pixels = picture(source, width, height, depth);

    const Bytes image = encode_with_every_set(pixels, width, height, depth, model, given);
    if (image.empty()) {
        require(!trained && !sound, "only an unsound table is refused");
        return 0;
    }
    check_frame(image, pixels, model, given);
    const Outcome decoded = decode_with_every_set(image);
    require(decoded.error == nullptr && decoded.pixels == pixels, "what is encoded decodes to itself");
    if (trained) check_training(pixels, width, height, depth, model);

    if (depth == 16) return 0;
    pixels[source.below(static_cast<std::uint32_t>(pixels.size()))] = static_cast<std::uint16_t>(1u << depth);
    require(encode_with_every_set(pixels, width, height, depth, model, given).empty(),
            "a value above the depth is refused");
    return 0;
}
