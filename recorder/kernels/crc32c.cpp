#include "crc32c.hpp"

#include <array>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace recorder {
namespace {

constexpr std::uint32_t polynomial = 0x82F63B78u;

using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr Tables make_tables() {
    Tables tables{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t crc = byte;
        for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1u) ? polynomial : 0u);
        tables[0][byte] = crc;
    }
    for (std::size_t slice = 1; slice < 8; ++slice)
        for (std::size_t byte = 0; byte < 256; ++byte) {
            const std::uint32_t crc = tables[slice - 1][byte];
            tables[slice][byte] = (crc >> 8) ^ tables[0][crc & 255u];
        }
    return tables;
}

constexpr Tables tables = make_tables();

std::uint64_t load(const std::uint8_t *p) {
    std::uint64_t word;
    std::memcpy(&word, p, sizeof word);
    return word;
}

// Slicing by eight (Kounavis and Berry 2005); `crc` is the running register.
std::uint32_t update_portable(std::uint32_t crc, const std::uint8_t *p, std::size_t size) {
    for (; size >= 8; p += 8, size -= 8) {
        const std::uint64_t word = load(p) ^ crc;
        crc = 0;
        for (std::size_t i = 0; i < 8; ++i) crc ^= tables[7 - i][(word >> (8 * i)) & 255u];
    }
    for (; size > 0; ++p, --size) crc = (crc >> 8) ^ tables[0][(crc ^ *p) & 255u];
    return crc;
}

// a * b modulo the polynomial, in the reflected representation (x^0 is the highest bit).
std::uint32_t multiply(std::uint32_t a, std::uint32_t b) {
    std::uint32_t product = 0;
    for (std::uint32_t bit = 0x80000000u; bit != 0; bit >>= 1) {
        if (a & bit) product ^= b;
        b = (b >> 1) ^ ((b & 1u) ? polynomial : 0u);
    }
    return product;
}

// x^(8 * bytes): what a register is multiplied by when `bytes` zero bytes pass through it.
std::uint32_t zeros_operator(std::size_t bytes) {
    std::uint32_t result = 0x80000000u;
    std::uint32_t square = 0x00800000u;  // x^8
    for (; bytes != 0; bytes >>= 1) {
        if (bytes & 1u) result = multiply(result, square);
        square = multiply(square, square);
    }
    return result;
}

#if defined(__x86_64__)

__attribute__((target("sse4.2"))) std::uint32_t update_one(std::uint32_t crc, const std::uint8_t *p,
                                                            std::size_t size) {
    std::uint64_t wide = crc;
    for (; size >= 8; p += 8, size -= 8) wide = _mm_crc32_u64(wide, load(p));
    crc = static_cast<std::uint32_t>(wide);
    for (; size > 0; ++p, --size) crc = _mm_crc32_u8(crc, *p);
    return crc;
}

// Three thirds at once: the instruction takes three cycles but starts every cycle.
__attribute__((target("sse4.2"))) std::uint32_t update_three(std::uint32_t crc, const std::uint8_t *p,
                                                              std::size_t size) {
    constexpr std::size_t worthwhile = 4096;
    if (size < worthwhile) return update_one(crc, p, size);
    const std::size_t third = size / 24 * 8;
    std::uint64_t a = crc, b = 0, c = 0;
    for (std::size_t i = 0; i < third; i += 8) {
        a = _mm_crc32_u64(a, load(p + i));
        b = _mm_crc32_u64(b, load(p + third + i));
        c = _mm_crc32_u64(c, load(p + 2 * third + i));
    }
    const std::uint32_t shift = zeros_operator(third);
    const std::uint32_t ab = multiply(static_cast<std::uint32_t>(a), shift) ^ static_cast<std::uint32_t>(b);
    const std::uint32_t abc = multiply(ab, shift) ^ static_cast<std::uint32_t>(c);
    return update_one(abc, p + 3 * third, size - 3 * third);
}

bool has_instruction() {
    static const bool has = __builtin_cpu_supports("sse4.2") != 0;
    return has;
}

#endif

}  // namespace

std::uint32_t crc32c_portable(const void *data, std::size_t size) {
    return ~update_portable(~0u, static_cast<const std::uint8_t *>(data), size);
}

std::uint32_t crc32c_update(std::uint32_t crc, const void *data, std::size_t size) {
    const auto *bytes = static_cast<const std::uint8_t *>(data);
#if defined(__x86_64__)
    if (has_instruction()) return update_three(crc, bytes, size);
#endif
    return update_portable(crc, bytes, size);
}

Crc32cZeros::Crc32cZeros(std::size_t bytes) : operator_(zeros_operator(bytes)) {}

std::uint32_t Crc32cZeros::pass(std::uint32_t crc) const { return multiply(crc, operator_); }

std::uint32_t crc32c(const void *data, std::size_t size) { return ~crc32c_update(crc32c_start, data, size); }

}  // namespace recorder
