// Thirty-two rows at once: row j of a group is decoded a fixed number of pixels behind row j - 1, whose results
// are its upper neighbours; where a row ends its lane goes straight on into that of the next group.
#pragma once

#include <array>
#include <cstdint>

#include "code_reader_vector.hpp"
#include "vector_set.hpp"

namespace recorder::RECORDER_VECTOR {

constexpr std::uint32_t wave_rows = 32;
constexpr std::uint32_t wave_parts = wave_rows / lanes16;
constexpr std::uint32_t wave_steps = 8;  // results are held for so many steps and then stored together

// A 16-bit number of each row. Its halves (of 128 bits) are, one after another, rows 7 to 0 and 23 to 16, then
// rows 15 to 8 and 31 to 24: so what stands above a half is a half at the same place of the other vector, and
// the row above comes by a shift within halves.
struct WaveLanes {
    Lanes part[wave_parts];
};

// Where a row's number stands among the 16-bit ones, and among the 32-bit ones that widened() makes of them.
constexpr std::uint32_t lane_of(std::uint32_t row) { return 16 * (row / 8 % 2) + 8 * (row / 16) + (7 - row % 8); }
constexpr std::uint32_t wide_lane_of(std::uint32_t row) {
    const std::uint32_t lane = lane_of(row);
    return lane / 16 * 16 + lane / 4 % 2 * 8 + lane / 8 % 2 * 4 + lane % 4;
}

// Of each row the number of the row above; of row 0 the one at p. Reads 16 bytes there.
RECORDER_INLINE WaveLanes from_above(const std::uint16_t *p, const WaveLanes &a) {
    return {{shifted_down16(a.part[0], before_low_half(p, a.part[1])), shifted_down16(a.part[1], a.part[0])}};
}

RECORDER_INLINE WaveLanes load_rows(const std::uint16_t *p) { return {{load(p), load(p + lanes16)}}; }
RECORDER_INLINE void store_rows(std::uint16_t *p, const WaveLanes &a) {
    store(p, a.part[0]);
    store(p + lanes16, a.part[1]);
}
RECORDER_INLINE WaveLanes choose(const WaveLanes &mask, const WaveLanes &yes, const WaveLanes &no) {
    return {{choose(mask.part[0], yes.part[0], no.part[0]), choose(mask.part[1], yes.part[1], no.part[1])}};
}

// What stands above row 0's pixel, and to the right of that, and a row further up. Seven pixels behind each
// can be read.
struct Above {
    const std::uint16_t *b, *d, *f;
};

// The rows in one step at an edge: all ones for each that is in the first column, in the last one, in row 1.
struct Edge {
    alignas(32) std::uint16_t starts[wave_rows], ends[wave_rows], row_1[wave_rows];
};

// Where the rows' pixels go.
class WaveRows {
  public:
    using Results = WaveLanes[wave_steps];

    // Rows 1 and below of the image, each `delay` pixels behind the one above; `sink` has room for one row and
    // sink_slack, and takes what belongs to none.
    WaveRows(std::uint16_t *image, std::uint32_t width, std::uint32_t height, std::uint32_t delay, std::uint16_t *sink)
        : image_(image), sink_(sink), width_(width), height_(height), delay_(delay) {
        last_.fill(sink);
    }

    bool exists(std::uint32_t group, std::uint32_t j) const { return row_of(group, j) < height_; }
    std::uint32_t groups() const { return (height_ - 1 + wave_rows - 1) / wave_rows; }

    // To be called whenever row 0 of a group starts.
    void start_group(std::uint32_t group) {
        if (group > 0) last_ = rows_;
        for (std::uint32_t j = 0; j < wave_rows; ++j)
            rows_[j] = exists(group, j) ? image_ + std::size_t{row_of(group, j)} * width_ : sink_;
        above_ = row_above(group);
        next_above_ = row_above(group + 1);
        above_2_ = group > 0 && above_ != sink_ ? above_ - width_ : above_;
    }
    // While row 0 stands at x. In row 1 the topmost row stands for the one above it.
    Above above(std::uint32_t x) const { return {above_ + x, above_ + x + 1, above_2_ + x}; }
    // The first pixel above row 0 of the next group.
    std::uint16_t next_above() const { return *next_above_; }

    // Asks for the memory that a quarter of the rows will soon be stored to: no processor foresees 32 of them.
    RECORDER_INLINE void prefetch_rows(std::uint32_t x) const {
        constexpr std::uint32_t line_pixels = 32, quarter = wave_rows / (line_pixels / wave_steps);
        const std::uint32_t first = x / wave_steps * quarter % wave_rows;
        for (std::uint32_t j = first; j < first + quarter; ++j) prefetch(rows_[j] + (x - delay_ * j) + 3 * line_pixels);
    }

    // Stores what was decoded while row 0 stood at x .. x + 7, where no row starts.
    RECORDER_INLINE void put(const Results &results, std::uint32_t x) const {
        for (std::uint32_t part = 0; part < wave_parts; ++part) {
            Lanes pixels[wave_steps];
            transpose(results, part, pixels);
            for (std::uint32_t i = 0; i < wave_steps; ++i) {
                const std::uint32_t j = row_at(part, i);
                store_low(rows_[j] + (x - delay_ * j), pixels[i]);
                store_high(rows_[j + 16] + (x - delay_ * (j + 16)), pixels[i]);
            }
        }
    }

    // The same where rows may end and start.
    void put_edge(const Results &results, std::uint32_t x) const {
        for (std::uint32_t part = 0; part < wave_parts; ++part) {
            Lanes pixels[wave_steps];
            transpose(results, part, pixels);
            for (std::uint32_t i = 0; i < wave_steps; ++i) {
                std::uint16_t two_rows[2 * wave_steps];
                store(two_rows, pixels[i]);
                put_row(two_rows, row_at(part, i), x);
                put_row(two_rows + wave_steps, row_at(part, i) + 16, x);
            }
        }
    }

  private:
    static std::uint32_t row_of(std::uint32_t group, std::uint32_t j) { return 1 + group * wave_rows + j; }
    const std::uint16_t *row_above(std::uint32_t group) const {
        const std::uint32_t y = row_of(group, 0) - 1;
        return y < height_ ? image_ + std::size_t{y} * width_ : sink_;
    }
    // The row at place i of a part's lower half.
    static constexpr std::uint32_t row_at(std::uint32_t part, std::uint32_t i) { return 8 * part + 7 - i; }

    void put_row(const std::uint16_t *pixels, std::uint32_t j, std::uint32_t x) const {
        for (std::uint32_t i = 0; i < wave_steps; ++i) {
            if (x + i >= delay_ * j) {
                rows_[j][x + i - delay_ * j] = pixels[i];
            } else {
                last_[j][x + i + width_ - delay_ * j] = pixels[i];
            }
        }
    }

    // pixels[i]: eight of row row_at(part, i), then eight of the row 16 on.
    RECORDER_INLINE static void transpose(const Results &results, std::uint32_t part, Lanes (&pixels)[wave_steps]) {
        Lanes pairs[8], fours[8];
        for (std::uint32_t i = 0; i < 4; ++i) {
            pairs[i] = interleave_low16(results[2 * i].part[part], results[2 * i + 1].part[part]);
            pairs[i + 4] = interleave_high16(results[2 * i].part[part], results[2 * i + 1].part[part]);
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
    std::uint32_t width_, height_, delay_;
    std::array<std::uint16_t *, wave_rows> rows_, last_;
};

// What the rows know from step to step, but for the model's History.
struct WaveState {
    alignas(32) std::uint32_t cursors[wave_rows];  // in bits; by wide_lane_of, all others by lane_of
    alignas(32) std::uint16_t values[wave_rows];
    alignas(32) std::uint16_t exponents[wave_rows];
};

// Decodes an image by a Model, which has
//   delay, at least the number of pixels that a row needs from above and to the right, plus one
//   History, the neighbours that it keeps from step to step, in memory by load(), store()
//   Around, what it asks of a vector's pixels: around<edge>(history, above, edge) for all
//   CodeLanes and how to read inside: interval(around), read_inside(interval)(word)
//   and next(history, values).
template <typename Model>
class Wave {
  public:
    static constexpr std::uint32_t edge_steps = Model::delay * wave_rows;
    static constexpr bool has_last_column = Model::delay > 1;  // the model asks for upper right neighbours

    Wave(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
         StreamEnds (&streams)[written_streams])
        : header_(header),
          streams_(streams),
          model_(header),
          reader_(payload, static_cast<std::size_t>(header.payload()), header.depth),
          rows_(image, header.width, header.height, Model::delay, sink) {}

    // Whether all was sound.
    bool run() {
        const std::uint32_t groups = rows_.groups(), plain_end = header_.width - (has_last_column ? wave_steps : 0);
        for (std::uint32_t group = 0; group <= groups; ++group) {
            rows_.start_group(group);
            if (group == 0) model_.start(history_, rows_.above(0));
            std::uint32_t x = 0;
            for (; x < edge_steps; x += wave_steps) edge(group, x);
            if (group == groups) break;
            for (; x < plain_end; x += wave_steps) {
                WaveRows::Results results;
                rows_.prefetch_rows(x);
                plain(rows_.above(x), results);
                rows_.put(results, x);
            }
            if (has_last_column) edge(group, x);
        }
        return sound_;
    }

  private:
    // Eight steps without edges, two for every word that is loaded.
    RECORDER_INLINE void plain(Above above, WaveRows::Results &results) {
        typename Model::History history = history_;
        Wide cursors[wave_parts];
        Evidence evidence[wave_parts];
        load_state(cursors, evidence);
        for (std::uint32_t i = 0; i < wave_steps; i += 2) {
            CodeReader::Offsets offsets[wave_parts];
            for (std::uint32_t h = 0; h < wave_parts; ++h) reader_.prepare(offsets[h], cursors[h]);
            typename Model::Around around = model_.template around<false>(history, above, nullptr);
            Words words[wave_parts];
            Wide skipped[wave_parts];
            Lanes lengths[wave_parts];
#pragma GCC unroll 2
            for (std::uint32_t h = 0; h < wave_parts; ++h) {
                words[h] = reader_.load(offsets[h]);
                skipped[h] = reader_.skipped_in_byte(cursors[h]);
                lengths[h] = decode(around, h, reader_.first_bits(words[h], skipped[h]), evidence[h], results[i]);
            }
            model_.next(history, results[i]);
            above = {above.b + 1, above.d + 1, above.f + 1};
            around = model_.template around<false>(history, above, nullptr);
#pragma GCC unroll 2
            for (std::uint32_t h = 0; h < wave_parts; ++h) {
                const Wide both_skipped = add32(skipped[h], widened(lengths[h]));
                const Lanes second =
                    decode(around, h, reader_.next_bits(words[h], both_skipped), evidence[h], results[i + 1]);
                cursors[h] = reader_.moved(cursors[h], add16(lengths[h], second));
            }
            model_.next(history, results[i + 1]);
            above = {above.b + 1, above.d + 1, above.f + 1};
        }
        history_ = history;
        store_state(cursors, evidence);
    }

    void step(const Above &above, const Edge &edge, WaveLanes &results) {
        Wide cursors[wave_parts];
        Evidence evidence[wave_parts];
        load_state(cursors, evidence);
        const typename Model::Around around = model_.template around<true>(history_, above, &edge);
        for (std::uint32_t h = 0; h < wave_parts; ++h) {
            CodeReader::Offsets offsets;
            reader_.prepare(offsets, cursors[h]);
            const Wide bits = reader_.first_bits(reader_.load(offsets), reader_.skipped_in_byte(cursors[h]));
            cursors[h] = reader_.moved(cursors[h], decode(around, h, bits, evidence[h], results));
        }
        model_.next(history_, results);
        store_state(cursors, evidence);
    }

    // Returns the lengths.
    RECORDER_INLINE Lanes decode(const typename Model::Around &around, std::uint32_t h, const Wide &bits,
                                 Evidence &evidence, WaveLanes &results) const {
        const typename Model::Interval interval = model_.interval(around, h);
        const CodeReader::Pixels pixels = reader_.read(bits, interval.code, evidence, model_.inside(interval));
        results.part[h] = pixels.value;
        return pixels.length;
    }

    // Eight steps in which rows may start or, in the last column, end.
    void edge(std::uint32_t group, std::uint32_t x) {
        WaveRows::Results results;
        for (std::uint32_t i = 0; i < wave_steps; ++i) {
            const std::uint32_t at = x + i;
            Edge edge{};
            if (at < edge_steps && at % Model::delay == 0) start_row(group, at / Model::delay, edge);
            Above above = rows_.above(at);
            // Row 0 sees the next row's first upper neighbour behind its last one.
            std::uint16_t right[8] = {rows_.next_above()};
            if (at + 1 == header_.width) {
                edge.ends[lane_of(0)] = 0xFFFF;
                above.d = right;
            }
            if (at % Model::delay == 1 && at + 1 < edge_steps) edge.ends[lane_of((at + 1) / Model::delay)] = 0xFFFF;
            step(above, edge, results[i]);
        }
        rows_.put_edge(results, x);
    }

    void start_row(std::uint32_t group, std::uint32_t j, Edge &edge) {
        const std::uint32_t lane = lane_of(j), wide_lane = wide_lane_of(j);
        StreamEnds &stream = streams_[(1 + j) % wave_rows];
        edge.starts[lane] = 0xFFFF;
        if (group == 0) {
            if (j == 0) edge.row_1[lane] = 0xFFFF;
            state_.cursors[wide_lane] = stream.bit;
            state_.values[lane] = 0;
            state_.exponents[lane] = 0xFFFF;
        } else if (!rows_.exists(group, j) && rows_.exists(group - 1, j)) {
            stream.bit = state_.cursors[wide_lane];
            sound_ = sound_ && stream.bit <= stream.end && state_.exponents[lane] != 0 &&
                     state_.values[lane] >> header_.depth == 0;
        }
    }

    RECORDER_INLINE void load_state(Wide (&cursors)[wave_parts], Evidence (&evidence)[wave_parts]) const {
        for (std::uint32_t h = 0; h < wave_parts; ++h) {
            cursors[h] = load_wide(state_.cursors + wide_lanes * h);
            evidence[h] = {load(state_.values + lanes16 * h), load(state_.exponents + lanes16 * h)};
        }
    }
    RECORDER_INLINE void store_state(const Wide (&cursors)[wave_parts], const Evidence (&evidence)[wave_parts]) {
        for (std::uint32_t h = 0; h < wave_parts; ++h) {
            store_wide(state_.cursors + wide_lanes * h, cursors[h]);
            store(state_.values + lanes16 * h, evidence[h].values);
            store(state_.exponents + lanes16 * h, evidence[h].exponent);
        }
    }

    const Header &header_;
    StreamEnds (&streams_)[written_streams];
    const Model model_;
    const CodeReader reader_;
    WaveRows rows_;
    WaveState state_{};
    typename Model::History history_{};
    bool sound_ = true;
};

}  // namespace recorder::RECORDER_VECTOR
