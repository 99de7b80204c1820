// Thirty-two rows at once: lane j decodes row j of a group, a fixed number of pixels behind lane j - 1, whose
// results are its upper neighbours; a lane at the end of its row goes straight on into that of the next group.
#pragma once

#include <array>
#include <cstdint>

#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::uint32_t wave_rows = 32;
constexpr std::uint32_t wave_steps = 8;  // results are held for so many steps and then stored together

constexpr std::uint32_t wave_vectors = wave_rows / lanes16;  // of 16-bit numbers
constexpr std::uint32_t vector_blocks = sizeof(Lanes) / 16;

// Where the lanes' pixels go. Results of a step are wave_vectors vectors of 16-bit numbers as pack32 leaves
// them, four lanes and four of the next vector in turns.
template <std::uint32_t delay>
class WaveRows {
  public:
    using Results = Lanes[wave_steps][wave_vectors];

    // Rows first_row and below of the image; `sink` has room for one row and takes what belongs to none.
    WaveRows(std::uint16_t *image, std::uint32_t width, std::uint32_t height, std::uint32_t first_row,
             std::uint16_t *sink)
        : image_(image), sink_(sink), width_(width), height_(height), first_row_(first_row) {
        last_.fill(sink);
    }

    bool exists(std::uint32_t group, std::uint32_t lane) const { return row_of(group, lane) < height_; }
    std::uint32_t groups() const { return (height_ - first_row_ + wave_rows - 1) / wave_rows; }

    // To be called whenever lane 0 starts a row.
    void start_group(std::uint32_t group) {
        if (group > 0) last_ = rows_;
        for (std::uint32_t j = 0; j < wave_rows; ++j)
            rows_[j] = exists(group, j) ? image_ + std::size_t{row_of(group, j)} * width_ : sink_;
        above_ = row_above(group);
        next_above_ = row_above(group + 1);
        above_2_ = group > 0 && above_ != sink_ ? above_ - width_ : above_;
    }
    // The row above lane 0's, the one above that (for row 1 the same), and the one above lane 0's next row.
    const std::uint16_t *above() const { return above_; }
    const std::uint16_t *above_2() const { return above_2_; }
    const std::uint16_t *next_above() const { return next_above_; }

    // Stores what was decoded while lane 0 stood at x .. x + 7, where no lane starts a row.
    RECORDER_INLINE void put(const Results &results, std::uint32_t x) const {
        for (std::uint32_t v = 0; v < wave_vectors; ++v) {
            Lanes pixels[wave_steps];
            transpose(results, v, pixels);
            for (std::uint32_t i = 0; i < wave_steps; ++i) {
                void *places[vector_blocks];
                for (std::uint32_t block = 0; block < vector_blocks; ++block) {
                    const std::uint32_t j = lane_of(v, i, block);
                    places[block] = rows_[j] + (x - delay * j);
                }
                store_blocks(places, pixels[i]);
            }
        }
    }

    // The same where lanes may end one row and start the next.
    void put_edge(const Results &results, std::uint32_t x) const {
        for (std::uint32_t v = 0; v < wave_vectors; ++v) {
            Lanes pixels[wave_steps];
            transpose(results, v, pixels);
            for (std::uint32_t i = 0; i < wave_steps; ++i) {
                std::uint16_t blocks[vector_blocks][wave_steps];
                store(blocks, pixels[i]);
                for (std::uint32_t block = 0; block < vector_blocks; ++block)
                    put_lane(blocks[block], lane_of(v, i, block), x);
            }
        }
    }

  private:
    std::uint32_t row_of(std::uint32_t group, std::uint32_t lane) const {
        return first_row_ + group * wave_rows + lane;
    }
    const std::uint16_t *row_above(std::uint32_t group) const {
        const std::uint32_t y = row_of(group, 0) - 1;
        return y < height_ ? image_ + std::size_t{y} * width_ : sink_;
    }
    // Whose pixels stand in the given block of 128 bits of pixels[i] of vector v.
    static constexpr std::uint32_t lane_of(std::uint32_t v, std::uint32_t i, std::uint32_t block) {
        return lanes16 * v + 4 * block + (i < 4 ? i : lanes32 + i - 4);
    }

    void put_lane(const std::uint16_t *pixels, std::uint32_t lane, std::uint32_t x) const {
        for (std::uint32_t i = 0; i < wave_steps; ++i) {
            if (x + i >= delay * lane) {
                rows_[lane][x + i - delay * lane] = pixels[i];
            } else {
                last_[lane][x + i + width_ - delay * lane] = pixels[i];
            }
        }
    }

    // pixels[i]: eight of each lane_of(v, i, block).
    RECORDER_INLINE static void transpose(const Results &results, std::uint32_t v, Lanes (&pixels)[wave_steps]) {
        Lanes pairs[8], fours[8];
        for (std::uint32_t i = 0; i < 4; ++i) {
            pairs[i] = interleave_low16(results[2 * i][v], results[2 * i + 1][v]);
            pairs[i + 4] = interleave_high16(results[2 * i][v], results[2 * i + 1][v]);
        }
        for (std::uint32_t i = 0; i < 8; i += 2) {
            fours[i] = interleave_low32(pairs[i], pairs[i + 1]);
            fours[i + 1] = interleave_high32(pairs[i], pairs[i + 1]);
        }
        for (std::uint32_t i = 0; i < 8; i += 4)
            for (std::uint32_t j = 0; j < 2; ++j) {
                pixels[i + 2 * j] = firsts64(fours[i + j], fours[i + j + 2]);
                pixels[i + 2 * j + 1] = seconds64(fours[i + j], fours[i + j + 2]);
            }
    }

    std::uint16_t *image_, *sink_;
    const std::uint16_t *above_ = nullptr, *above_2_ = nullptr, *next_above_ = nullptr;
    std::uint32_t width_, height_, first_row_;
    std::array<std::uint16_t *, wave_rows> rows_, last_;
};

}  // namespace recorder::RECORDER_VECTOR
