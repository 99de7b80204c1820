// Round trips and broken images for the kernels, built by tools/sanitize.sh under the address and
// undefined-behaviour sanitizers. Every buffer is its own allocation of exactly its size. The last line printed
// has a checksum of all that was written and read: every instruction set must come to the same.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "stuffing.hpp"
#include "unpack.hpp"

using namespace recorder;
using Random = std::mt19937;

namespace {

std::uint32_t below(Random &random, std::uint32_t limit) {
    return std::uniform_int_distribution<std::uint32_t>(0, limit - 1)(random);
}

template <typename T>
std::unique_ptr<T[]> exact(const T *source, std::size_t count) {
    std::unique_ptr<T[]> copy(new T[count]);
    std::copy_n(source, count, copy.get());
    return copy;
}

void require(bool holds, const char *what) {
    if (holds) return;
    std::fprintf(stderr, "failed: %s\n", what);
    std::exit(1);
}

std::unique_ptr<std::uint16_t[]> picture(Random &random, std::uint32_t width, std::uint32_t height,
                                         std::uint32_t depth) {
    const std::size_t count = std::size_t{width} * height;
    const std::uint32_t top = 1u << depth, spread = 1u + below(random, top);
    std::unique_ptr<std::uint16_t[]> pixels(new std::uint16_t[count]);
    std::uint32_t level = below(random, top);
    for (std::size_t i = 0; i < count; ++i) {
        level = std::min(top - 1u, level + below(random, spread) - std::min(level, spread / 2u));
        pixels[i] = static_cast<std::uint16_t>(level);
    }
    return pixels;
}

std::uint32_t digest = 0;

template <typename T>
void note(const T *data, std::size_t count) {
    digest = crc32c_update(digest, data, count * sizeof *data);
}

// Notes the pixels, or what is wrong with the bytes and where.
void decode_anything(const std::vector<std::uint8_t> &bytes) {
    const auto data = exact(bytes.data(), bytes.size());
    try {
        const Header header = parse_image(data.get(), bytes.size()).header;
        const std::size_t count = std::size_t{header.width} * header.height;
        std::unique_ptr<std::uint16_t[]> pixels(new std::uint16_t[count]);
        decode(pixels.get(), count, data.get(), bytes.size());
        note(pixels.get(), count);
    } catch (const FormatError &error) {
        require(error.offset <= bytes.size(), "an error's offset inside the image");
        note(error.what, std::strlen(error.what));
        note(&error.offset, 1);
    }
}

void mutate(Random &random, std::vector<std::uint8_t> &bytes) {
    const std::size_t at = below(random, static_cast<std::uint32_t>(bytes.size()));
    switch (below(random, 5)) {
        case 0: bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1u << below(random, 8))); break;
        case 1: bytes[at] = static_cast<std::uint8_t>(below(random, 256)); break;
        case 2: bytes.resize(at); break;
        case 3: bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(at)); break;
        default: bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), 0xFF); break;
    }
}

// Behind a header that holds, anything: this reaches the bit readers every time.
void scramble(Random &random, std::vector<std::uint8_t> &bytes) {
    const std::size_t begin = parse_header(bytes.data(), bytes.size()).end;
    const std::uint32_t limit = 1u + below(random, 255);  // low limits make long runs of equal bits
    for (std::size_t i = begin; i + marker_size < bytes.size(); ++i)
        bytes[i] = static_cast<std::uint8_t>(below(random, limit));
}

void one_picture(Random &random) {
    const std::uint32_t depth = 1u + below(random, 16), width = 1u + below(random, 170), height = 1u + below(random, 70);
    const auto pixels = picture(random, width, height, depth);
    std::vector<std::uint8_t> bytes(largest_encoding(width, height, depth));
    {
        const std::unique_ptr<std::uint8_t[]> target(new std::uint8_t[bytes.size()]);
        Model model = static_cast<Model>(below(random, 3));
        if (depth > deepest_ls && model == Model::felics_ls) model = Model::felics;
        bytes.resize(encode(target.get(), pixels.get(), width, height, depth, model, nullptr));
        std::copy_n(target.get(), bytes.size(), bytes.begin());
    }
    note(bytes.data(), bytes.size());
    const std::size_t count = std::size_t{width} * height;
    std::unique_ptr<std::uint16_t[]> decoded(new std::uint16_t[count]);
    decode(decoded.get(), count, exact(bytes.data(), bytes.size()).get(), bytes.size());
    require(std::equal(pixels.get(), pixels.get() + count, decoded.get()), "the round trip");

    for (int i = 0; i < 12; ++i) {
        std::vector<std::uint8_t> broken = bytes;
        mutate(random, broken);
        decode_anything(broken);
        broken = bytes;
        scramble(random, broken);
        decode_anything(broken);
    }
}

void one_unpacking(Random &random) {
    const std::size_t count = below(random, 40), size = (10 * count + 7) / 8;
    std::unique_ptr<std::uint8_t[]> packed(new std::uint8_t[size]());
    std::unique_ptr<std::uint16_t[]> pixels(new std::uint16_t[count]);
    unpack_mono10p(pixels.get(), count, packed.get());
    next_marker(packed.get(), size, 0);
    require(crc32c(packed.get(), size) == crc32c_portable(packed.get(), size), "equal checksums");
}

}  // namespace

int main(int argc, char **argv) {
    const int pictures = argc > 1 ? std::atoi(argv[1]) : 1000;
    Random random(1);
    for (int i = 0; i < pictures; ++i) {
        one_picture(random);
        one_unpacking(random);
    }
    std::printf("%d pictures, %d broken ones: nothing found, checksum %08X\n", pictures, 24 * pictures, digest);
}
