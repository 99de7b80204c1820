// What the model felics-ls looks at, laid out for vectors.
#pragma once

#include <cstddef>
#include <cstdint>

namespace recorder {

// The last three rows with what stands for the pixels beside them, so that no step has edges to mind.
class LsLines {
  public:
    static constexpr std::uint32_t before = 16, behind = 80;

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

}  // namespace recorder
