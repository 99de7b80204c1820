// Most-significant-bit-first streams in 64-bit steps.
#pragma once

#include <cstdint>
#include <cstring>

#if !defined(__BYTE_ORDER__) || __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the kernels are written for little-endian machines"
#endif

namespace recorder {

[[gnu::always_inline]] inline std::uint64_t load_big_endian(const std::uint8_t *p) {
    std::uint64_t word;
    std::memcpy(&word, p, sizeof word);
    return __builtin_bswap64(word);
}

[[gnu::always_inline]] inline void store_big_endian(std::uint8_t *p, std::uint64_t word) {
    word = __builtin_bswap64(word);
    std::memcpy(p, &word, sizeof word);
}

// floor(log2(n)) of n >= 1.
[[gnu::always_inline]] inline std::uint32_t floor_log2(std::uint32_t n) {
    return 31u - static_cast<std::uint32_t>(__builtin_clz(n));
}

// The same of 1 <= n < 2^24 by the exponent of n as a float: slower for one number, but there are
// vector instructions for it.
[[gnu::always_inline]] inline std::uint32_t floor_log2_by_float(std::uint32_t n) {
    const float number = static_cast<float>(static_cast<std::int32_t>(n));
    std::uint32_t word;
    std::memcpy(&word, &number, sizeof word);
    return (word >> 23) - 127u;
}

// Appends bits. Every append stores 8 bytes at the cursor: the caller leaves 8 bytes of room behind the end.
class BitWriter {
  public:
    BitWriter() = default;
    explicit BitWriter(std::uint8_t *begin) : begin_(begin), cursor_(begin) {}

    // Appends the low `length` bits of `value`, 1 <= length <= 56, all higher bits zero.
    [[gnu::always_inline]] void append(std::uint64_t value, std::uint32_t length) {
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
    friend class WordWriter;

    std::uint8_t *begin_ = nullptr;
    std::uint8_t *cursor_ = nullptr;
    std::uint64_t pending_ = 0;
    std::uint32_t used_ = 0;
};

// Goes on where a BitWriter stands, with longer words and fewer steps for each, until finish(). Stores the
// whole 64 bits around its end.
class WordWriter {
  public:
    explicit WordWriter(const BitWriter &from) : begin_(from.cursor_), pending_(from.pending_), end_(from.used_) {}

    // Appends the high `length` bits of `word`, 0 <= length <= 63, all lower bits zero. (Shifts count
    // modulo 64, as the machine's do; where the second one would be by 64 its result is not used.)
    [[gnu::always_inline]] void append(std::uint64_t word, std::uint64_t length) {
        const std::uint64_t joined = pending_ | (word >> (end_ & 63u)), rest = word << ((0u - end_) & 63u);
        const std::uint64_t at = end_ >> 6;
        store_big_endian(begin_ + 8 * at, joined);
        end_ += length;
        pending_ = end_ >> 6 != at ? rest : joined;
    }

    void finish(BitWriter &to) const {
        const std::uint64_t used = end_ & 63u;
        store_big_endian(begin_ + 8 * (end_ >> 6), pending_);
        to.cursor_ = begin_ + (end_ >> 3);
        to.pending_ = pending_ << (used & 56u);
        to.used_ = static_cast<std::uint32_t>(used & 7u);
    }

  private:
    std::uint8_t *begin_;
    std::uint64_t pending_;  // the bits behind the last whole 64
    std::uint64_t end_;      // bits since begin_
};

// 57 or more valid bits from bit position `bit` on, left-aligned. Reads 8 bytes from byte bit / 8.
[[gnu::always_inline]] inline std::uint64_t peek(const std::uint8_t *base, std::size_t bit) {
    return load_big_endian(base + (bit >> 3)) << (bit & 7u);
}

}  // namespace recorder
