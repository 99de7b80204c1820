#include "vector_set.hpp"

#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::size_t block = sizeof(Lanes);

bool stuff(Span &span, std::uint8_t mask, std::size_t &extra) {
    const Lanes masks = all8(mask), prefixes = all8(0xFF);
    Span at = span;
    while (at.size >= block) {
        const Lanes bytes = differing(load(at.source), masks);
        const auto found = equal_bits8(bytes, prefixes);
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
        const auto found = equal_bits8(bytes, prefixes);
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

}  // namespace recorder::RECORDER_VECTOR
