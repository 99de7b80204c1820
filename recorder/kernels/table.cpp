#include <algorithm>

#include "felics.hpp"

namespace recorder {

void write_table(std::uint8_t *target, const Header &header) {
    if (header.model == Model::felics) {
        std::copy(header.table.begin(), header.table.end(), target);
    } else if (header.model == Model::felics_ls) {
        target = std::copy(header.ls_table.codes.begin(), header.ls_table.codes.end(), target);
        for (const auto &weights : header.ls_table.weights)
            for (const std::int16_t weight : weights) {
                *target++ = static_cast<std::uint8_t>(weight & 255);
                *target++ = static_cast<std::uint8_t>((weight >> 8) & 255);
            }
    }
}

void read_table(Header &header, const std::uint8_t *bytes) {
    if (header.model == Model::felics) {
        std::copy_n(bytes, contexts, header.table.begin());
    } else if (header.model == Model::felics_ls) {
        std::copy_n(bytes, ls_contexts, header.ls_table.codes.begin());
        bytes += ls_contexts;
        for (auto &weights : header.ls_table.weights)
            for (std::int16_t &weight : weights) {
                weight = static_cast<std::int16_t>(bytes[0] | bytes[1] << 8);
                bytes += 2;
            }
    }
}

std::size_t sound_table(const Header &header) {
    if (header.model == Model::felics) {
        for (std::size_t c = 0; c < contexts; ++c)
            if (header.table[c] > 15 || header.table[c] > header.depth) return c;
    } else if (header.model == Model::felics_ls) {
        for (std::size_t c = 0; c < ls_contexts; ++c)
            if ((header.ls_table.codes[c] & 15u) > header.depth || header.ls_table.codes[c] >> 4 > header.depth) return c;
    }
    return table_size(header.model);
}

void train(Header &header, const std::uint16_t *pixels) {
    if (header.model == Model::felics) header.table = train_table(pixels, header.width, header.height, header.depth);
    if (header.model == Model::felics_ls)
        header.ls_table = train_ls_table(pixels, header.width, header.height, header.depth);
}

}  // namespace recorder
