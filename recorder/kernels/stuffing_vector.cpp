#include "vector_set.hpp"

#include "lanes.hpp"
#include "stuffing.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::size_t block = sizeof(Lanes);

bool stuff(Span &span, std::uint8_t mask, std::size_t &extra) {
    const Lanes masks = all8(mask), prefixes = all8(0xFF);
    Span at = span;
    while (at.size >= block) {
        const Lanes bytes = differing(load(at.source), masks);
        const auto found = high_bits8(equal8(bytes, prefixes));
        store(at.target, bytes);
        // Few blocks hold an FF: it ends there, and what was stored behind is written again.
        const std::size_t count = found != 0 ? lowest_bit(found) + 1u : block;
        at.target += count;
        at.source += count;
        at.size -= count;
        if (found != 0) {
            if (extra-- == 0) return false;
            *at.target++ = 0;
        }
    }
    span = at;
    return true;
}

void unstuff(Span &span, std::uint8_t mask) {
    const Lanes masks = all8(mask), prefixes = all8(0xFF);
    Span at = span;
    while (at.size > block) {
        const Lanes bytes = load(at.source);
        const auto found = high_bits8(equal8(bytes, prefixes));
        store(at.target, differing(bytes, masks));
        std::size_t count = block, dropped = 0;
        if (found != 0) {
            count = lowest_bit(found) + 1u;
            dropped = 1;
            if (at.source[count] != 0) break;
        }
        at.target += count;
        at.source += count + dropped;
        at.size -= count + dropped;
    }
    span = at;
}

std::size_t next_marker(const std::uint8_t *data, std::size_t size, std::size_t from) {
    constexpr std::size_t blocks = 4;
    const Lanes prefixes = all8(marker_prefix), starts = all8(start_of_image), but_lowest = all8(0xFE);
    static_assert(end_of_image == (start_of_image | 1), "one comparison finds both");
    const auto markers = [&](const std::uint8_t *at) {
        return common(equal8(load(at), prefixes), equal8(common(load(at + 1), but_lowest), starts));
    };
    if (size <= blocks * block) return from;
    for (const std::size_t last = size - blocks * block; from < last; from += blocks * block) {
        const std::uint8_t *at = data + from;
        decltype(markers(at)) found[blocks];
        for (std::size_t i = 0; i < blocks; ++i) found[i] = markers(at + i * block);
        if (!any(both(both(found[0], found[1]), both(found[2], found[3])))) continue;
        for (std::size_t i = 0; i < blocks; ++i)
            if (const auto bits = high_bits8(found[i])) return from + i * block + lowest_bit(bits);
    }
    return from;
}

}  // namespace recorder::RECORDER_VECTOR
