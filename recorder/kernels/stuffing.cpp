#include "stuffing.hpp"

#include <cstring>

#include "error.hpp"
#include "vector_kernels.hpp"

namespace recorder {
namespace {

// FF is rare, so both directions are memchr (a vector instruction per 32 bytes) and this plain copy,
// which the compiler vectorises.
void copy_masked(std::uint8_t *__restrict target, const std::uint8_t *__restrict source, std::size_t size,
                 std::uint8_t mask) {
    for (std::size_t i = 0; i < size; ++i) target[i] = static_cast<std::uint8_t>(source[i] ^ mask);
}

// The bytes up to and with the next `byte`, or `size` if there is none.
std::size_t span_through(const std::uint8_t *source, std::size_t size, int byte, bool &found) {
    const void *hit = size == 0 ? nullptr : std::memchr(source, byte, size);
    found = hit != nullptr;
    return found ? static_cast<std::size_t>(static_cast<const std::uint8_t *>(hit) - source) + 1 : size;
}

}  // namespace

bool stuff(std::uint8_t *&target, const std::uint8_t *source, std::size_t size, std::uint8_t mask,
           std::size_t &extra) {
    std::uint8_t *out = target;
    if (const VectorKernels *vectors = vector_kernels(); vectors != nullptr) {
        Span rest{target, source, size};
        if (!vectors->stuff(rest, mask, extra)) return false;
        out = rest.target;
        source = rest.source;
        size = rest.size;
    }
    while (size > 0) {
        bool found;
        const std::size_t span = span_through(source, size, marker_prefix ^ mask, found);
        copy_masked(out, source, span, mask);
        out += span;
        source += span;
        size -= span;
        if (found) {
            if (extra-- == 0) return false;
            *out++ = 0;
        }
    }
    target = out;
    return true;
}

std::size_t unstuff(std::uint8_t *target, const std::uint8_t *source, std::size_t size, std::uint8_t mask,
                    std::size_t offset) {
    std::uint8_t *out = target;
    if (const VectorKernels *vectors = vector_kernels(); vectors != nullptr) {
        Span rest{target, source, size};
        vectors->unstuff(rest, mask);
        out = rest.target;
        offset += static_cast<std::size_t>(rest.source - source);
        source = rest.source;
        size = rest.size;
    }
    while (size > 0) {
        bool found;
        const std::size_t span = span_through(source, size, marker_prefix, found);
        copy_masked(out, source, span, mask);
        out += span;
        source += span;
        size -= span;
        offset += span;
        if (found) {
            if (size == 0 || *source != 0) throw FormatError{"FF that is not followed by 00", offset - 1};
            ++source;
            --size;
            ++offset;
        }
    }
    return static_cast<std::size_t>(out - target);
}

std::size_t stuffed_position(const std::uint8_t *source, std::size_t size, std::size_t index) {
    std::size_t position = 0;
    while (position < size && index > 0) {
        bool found;
        const std::size_t left = size - position;
        const std::size_t span = span_through(source + position, index < left ? index : left, marker_prefix, found);
        position += span + (found ? 1 : 0);
        index -= span;
    }
    return position < size ? position : size;
}

std::size_t next_marker(const std::uint8_t *data, std::size_t size, std::size_t from) {
    while (from < size) {
        bool found;
        from += span_through(data + from, size - from, marker_prefix, found);
        if (found && from < size && (data[from] == start_of_image || data[from] == end_of_image)) return from - 1;
    }
    return size;
}

}  // namespace recorder
