// The model felics-ls in 16-bit lanes, 32 pixels a step.
#pragma once

#include <cstdint>

#include "bits.hpp"
#include "model_ls.hpp"

namespace recorder::avx2 {

// The last three rows with what stands for the pixels beside them, so that no step has edges to mind.
class LsLines {
  public:
    static constexpr std::uint32_t before = 16, behind = 48;

    static std::size_t size(std::uint32_t width) { return 3 * (std::size_t{width} + before + behind); }
    // `memory` has room for size(width).
    LsLines(std::uint16_t *memory, std::uint32_t width);

    // Takes the next row; `beside` stands for the pixels left of it.
    void add(const std::uint16_t *row, std::uint32_t beside);

    // The newest row, and the rows above.
    const std::uint16_t *line(std::uint32_t above) const { return lines_[above]; }

  private:
    std::uint32_t width_;
    std::uint16_t *lines_[3];
};

// Appends the newest row, which has a row above it, and returns `crc` (a running CRC-32C register) moved on over
// its pixels, which also stand at `row`.
std::uint32_t encode_ls_row(BitWriter &writer, const LsLines &lines, const std::uint16_t *row, std::uint32_t width,
                            bool two_above, std::uint32_t depth, const LsTable &table, std::uint32_t crc);

}  // namespace recorder::avx2
