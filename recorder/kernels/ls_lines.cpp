#include "ls_lines.hpp"

#include <algorithm>

namespace recorder {

LsLines::LsLines(std::uint16_t *memory, std::uint32_t width) : width_(width) {
    std::fill_n(memory, size(width), std::uint16_t{0});
    for (std::uint32_t i = 0; i < 3; ++i)
        lines_[i] = memory + i * (std::size_t{width} + before + behind) + before;
}

void LsLines::add(const std::uint16_t *row, std::uint32_t beside) {
    std::rotate(lines_, lines_ + 2, lines_ + 3);
    std::copy_n(row, width_, lines_[0]);
    lines_[0][-1] = lines_[0][-2] = static_cast<std::uint16_t>(beside);
    lines_[0][width_] = row[width_ - 1];
}

}  // namespace recorder
