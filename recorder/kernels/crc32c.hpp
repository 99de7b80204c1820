// CRC-32C (Castagnoli, RFC 3720 appendix B.4): reflected polynomial 0x82F63B78, initial and final value all ones.
#pragma once

#include <cstddef>
#include <cstdint>

namespace recorder {

// The CRC-32C of `size` bytes; with the SSE4.2 instruction where the processor has it.
std::uint32_t crc32c(const void *data, std::size_t size);

// The same by tables alone, on every machine.
std::uint32_t crc32c_portable(const void *data, std::size_t size);

// The same in pieces: from crc32c_start, over each piece, and inverted at the end.
constexpr std::uint32_t crc32c_start = ~0u;
std::uint32_t crc32c_update(std::uint32_t crc, const void *data, std::size_t size);

// Lets so many zero bytes pass through a register. A CRC is linear: of data that are zero but in parts, each of
// whose registers began with zero (the first with crc32c_start), it is the exclusive or of theirs.
class Crc32cZeros {
  public:
    explicit Crc32cZeros(std::size_t bytes);
    std::uint32_t pass(std::uint32_t crc) const;

  private:
    std::uint32_t operator_;
};

}  // namespace recorder
