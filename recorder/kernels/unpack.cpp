#include "unpack.hpp"

#include <cstring>

#include "bits.hpp"

namespace recorder {
namespace {

// Four pixels of the 40 low bits of `group`, each into its own 16.
std::uint64_t spread(std::uint64_t group) {
    return (group & 1023u) | ((group << 6) & (std::uint64_t{1023} << 16)) |
           ((group << 12) & (std::uint64_t{1023} << 32)) | ((group << 18) & (std::uint64_t{1023} << 48));
}

}  // namespace

void unpack_mono10p(std::uint16_t *pixels, std::size_t count, const std::uint8_t *packed) {
    const std::size_t bytes = (10 * count + 7) / 8;
    std::size_t i = 0, at = 0;
    for (; i + 4 <= count && at + 8 <= bytes; i += 4, at += 5) {
        std::uint64_t group;
        std::memcpy(&group, packed + at, sizeof group);
        group = spread(group);
        std::memcpy(pixels + i, &group, sizeof group);
    }
    for (; i < count; i += 4, at += 5) {
        std::uint64_t group = 0;
        const std::size_t left = bytes - at;
        std::memcpy(&group, packed + at, left < 5 ? left : 5);
        group = spread(group);
        const std::size_t wanted = count - i;
        std::memcpy(pixels + i, &group, 2 * (wanted < 4 ? wanted : 4));
    }
}

}  // namespace recorder
