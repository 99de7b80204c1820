// What both fuzz targets need: buffers of exactly their size, so that the sanitizers see every byte read or
// written outside, and each kernel in both its builds.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "cpu.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "stuffing.hpp"

namespace recorder {

using Bytes = std::vector<std::uint8_t>;

inline void require(bool holds, const char *what) {
    if (holds) return;
    std::fprintf(stderr, "does not hold: %s\n", what);
    std::abort();
}

template <typename T>
std::unique_ptr<T[]> exact(const T *source, std::size_t count) {
    std::unique_ptr<T[]> copy(new T[count]);
    std::copy_n(source, count, copy.get());
    return copy;
}

// What `kernel` returns with the portable build, which the one for this processor must return as well.
template <typename Kernel>
auto in_both_builds(const char *what, Kernel kernel) {
    baseline_only = true;
    const auto portable = kernel();
    baseline_only = false;
    require(kernel() == portable, what);
    return portable;
}

// An image decoded, or why not.
struct Outcome {
    std::vector<std::uint16_t> pixels;
    const char *error = nullptr;
    std::size_t offset = 0;

    bool operator==(const Outcome &other) const {
        return pixels == other.pixels && offset == other.offset &&
               (error == nullptr) == (other.error == nullptr) &&
               (error == nullptr || std::string(error) == other.error);
    }
    bool failed_by(const char *what) const { return error != nullptr && std::string(error) == what; }
};

// Where only the checksum of the pixels is wrong they are returned beside the error.
inline Outcome decode(const std::uint8_t *data, std::size_t size) {
    Outcome result;
    std::unique_ptr<std::uint16_t[]> pixels;
    std::size_t count = 0;
    try {
        const Header header = parse_image(data, size).header;
        count = std::size_t{header.width} * header.height;
        require(count <= 8 * size, "no picture has more pixels than eight times its bytes");
        pixels.reset(new std::uint16_t[count]);
        decode(pixels.get(), count, data, size);
    } catch (const FormatError &error) {
        require(error.offset <= size, "an error is inside the image");
        result.error = error.what;
        result.offset = error.offset;
    }
    if (result.error == nullptr || result.failed_by("the pixels' checksum is wrong"))
        result.pixels.assign(pixels.get(), pixels.get() + count);
    return result;
}

inline Outcome decode_in_both_builds(const Bytes &image) {
    const auto data = exact(image.data(), image.size());
    return in_both_builds("both builds decode alike", [&] { return decode(data.get(), image.size()); });
}

// An image, empty if an argument was refused.
inline Bytes encode_in_both_builds(const std::vector<std::uint16_t> &pixels, std::uint32_t width,
                                   std::uint32_t height, std::uint32_t depth, Model model,
                                   const std::uint8_t *table) {
    const auto source = exact(pixels.data(), pixels.size());
    return in_both_builds("both builds encode alike", [&]() -> Bytes {
        const std::size_t room = largest_encoding(width, height, depth);
        const std::unique_ptr<std::uint8_t[]> target(new std::uint8_t[room]);
        try {
            const std::size_t size = encode(target.get(), source.get(), width, height, depth, model, table);
            require(size <= room, "no image is larger than the largest");
            return Bytes(target.get(), target.get() + size);
        } catch (const ArgumentError &) {
            return {};
        }
    });
}

}  // namespace recorder
