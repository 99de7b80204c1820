// Most-significant-bit-first streams in 64-bit steps.
#pragma once

#include <cstdint>
#include <cstring>

#if !defined(__BYTE_ORDER__) || __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the kernels are written for little-endian machines"
#endif

namespace recorder {

inline std::uint64_t load_big_endian(const std::uint8_t *p) {
    std::uint64_t word;
    std::memcpy(&word, p, sizeof word);
    return __builtin_bswap64(word);
}

inline void store_big_endian(std::uint8_t *p, std::uint64_t word) {
    word = __builtin_bswap64(word);
    std::memcpy(p, &word, sizeof word);
}

// floor(log2(n)) of n >= 1.
inline std::uint32_t floor_log2(std::uint32_t n) {
    return 31u - static_cast<std::uint32_t>(__builtin_clz(n));
}

// Appends bits. Every append stores 8 bytes at the cursor: the caller leaves 8 bytes of room behind the end.
class BitWriter {
  public:
    BitWriter() = default;
    explicit BitWriter(std::uint8_t *begin) : begin_(begin), cursor_(begin) {}

    // Appends the low `length` bits of `value`, 1 <= length <= 56, all higher bits zero.
    void append(std::uint64_t value, std::uint32_t length) {
        pending_ |= value << (64u - used_ - length);
        store_big_endian(cursor_, pending_);
        used_ += length;
        cursor_ += used_ >> 3;
        pending_ <<= used_ & 56u;
        used_ &= 7u;
    }

    // Bytes so far, the last one padded with zero bits.
    std::size_t size() const {
        return static_cast<std::size_t>(cursor_ - begin_) + (used_ != 0 ? 1 : 0);
    }

  private:
    std::uint8_t *begin_ = nullptr;
    std::uint8_t *cursor_ = nullptr;
    std::uint64_t pending_ = 0;
    std::uint32_t used_ = 0;
};

// 57 or more valid bits from bit position `bit` on, left-aligned. Reads 8 bytes from byte bit / 8.
inline std::uint64_t peek(const std::uint8_t *base, std::size_t bit) {
    return load_big_endian(base + (bit >> 3)) << (bit & 7u);
}

}  // namespace recorder
