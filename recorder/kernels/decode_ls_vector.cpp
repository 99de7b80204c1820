#include "vector_set.hpp"

#include "model_ls_vector.hpp"
#include "wavefront_vector.hpp"
#include "wide.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

constexpr std::uint32_t delay = 2;  // a row needs its upper right neighbour
constexpr std::uint32_t edge_steps = delay * wave_rows;
using Rows = WaveRows<delay>;

// Thirty-two 16-bit numbers, lane after lane.
struct All {
    Lanes part[wave_vectors];
};

RECORDER_INLINE All load_all(const std::uint16_t *p) {
    All a;
    for (std::uint32_t i = 0; i < wave_vectors; ++i) a.part[i] = load(p + i * lanes16);
    return a;
}
RECORDER_INLINE All equal_all(Lanes a) {
    All all;
    for (Lanes &part : all.part) part = a;
    return all;
}
RECORDER_INLINE void store_all(std::uint16_t *p, const All &a) {
    for (std::uint32_t i = 0; i < wave_vectors; ++i) store(p + i * lanes16, a.part[i]);
}
RECORDER_INLINE All choose(const All &mask, const All &yes, const All &no) {
    All chosen;
    for (std::uint32_t i = 0; i < wave_vectors; ++i)
        chosen.part[i] = RECORDER_VECTOR::choose(mask.part[i], yes.part[i], no.part[i]);
    return chosen;
}
RECORDER_INLINE All shifted_up16(Lanes first, const All &a) {
    All shifted;
    for (std::uint32_t i = 0; i < wave_vectors; ++i)
        shifted.part[i] = RECORDER_VECTOR::shifted_up16(i > 0 ? a.part[i - 1] : first, a.part[i]);
    return shifted;
}
// The sixteen numbers from number 16 h on of those that begin with `a`.
RECORDER_INLINE Wide widened(Lanes a, std::uint32_t h) {
    Wide wide;
    for (std::uint32_t i = 0; i < wide_parts; ++i)
        wide.part[i] = (h * wide_parts + i) % 2 == 0 ? widened_low16(a) : widened_high16(a);
    return wide;
}

// What the lanes know from step to step, named as in the model: a is the last pixel, e the one before, d the
// upper right neighbour of the last step and so b of the next one.
struct State {
    alignas(sizeof(Lanes)) std::uint32_t cursors[wave_rows];
    alignas(sizeof(Lanes)) std::uint32_t values[wave_rows];
    alignas(sizeof(Lanes)) std::uint32_t zeros[wave_rows];
    alignas(sizeof(Lanes)) std::uint16_t a[wave_rows], e[wave_rows], d[wave_rows], b[wave_rows], b_before[wave_rows];
};

// The lanes in one step at an edge.
struct Edge {
    alignas(sizeof(Lanes)) std::uint16_t starts[wave_rows];  // all ones: in the first column
    alignas(sizeof(Lanes)) std::uint16_t ends[wave_rows];    // in the last one
    alignas(sizeof(Lanes)) std::uint16_t row_1[wave_rows];   // in row 1
};

class LsDecoder {
  public:
    LsDecoder(const std::uint8_t *payload, const Header &header)
        : model_(header.ls_table, header.depth),
          source_(payload),
          limit_(kept(all32(static_cast<std::uint32_t>(8 * header.payload()) + 64u))),
          escape_length_(kept(all32(longest_code(header.depth)))),
          escape_shift_(kept(all32(32u - header.depth))),
          middle_(kept(all16(1u << (header.depth - 1u)))) {}

    // `right_above` and `above_2` are d and f of lane 0, step by step.
    template <std::uint32_t steps, bool edge>
    RECORDER_INLINE void advance(State &state, const std::uint16_t *right_above, const std::uint16_t *above_2,
                                 Lanes (*results)[wave_vectors], const Edge *at) const {
        Wide cursors[2], values[2], zeros[2];
        for (std::uint32_t h = 0; h < 2; ++h) {
            cursors[h] = load_wide(state.cursors + wide_lanes * h);
            values[h] = load_wide(state.values + wide_lanes * h);
            zeros[h] = load_wide(state.zeros + wide_lanes * h);
        }
        All a = load_all(state.a), e = load_all(state.e), last_d = load_all(state.d);
        All last_b = load_all(state.b), b_before = load_all(state.b_before);
        for (std::uint32_t i = 0; i < steps; ++i) {
            const All next_b = shifted_up16(all16(right_above[i]), a), f = shifted_up16(all16(above_2[i]), b_before);
            const All b = last_d;
            All c = last_b, d = next_b;
            if (edge) {
                const All starts = load_all(at->starts), row_1 = load_all(at->row_1);
                a = choose(starts, b, a);
                e = choose(starts, b, e);
                c = choose(starts, choose(row_1, equal_all(middle_), f), c);
                d = choose(load_all(at->ends), b, d);
            }
            BigEndianGather::Offsets offsets[2];
#pragma GCC unroll 2
            for (std::uint32_t h = 0; h < 2; ++h) BigEndianGather::prepare(offsets[h], right32<3>(cursors[h]));
            Intervals intervals;
            Wide pixels[2];
#pragma GCC unroll 2
            for (std::uint32_t h = 0; h < 2; ++h) {
                const std::uint32_t v = h * wave_vectors / 2;
                if (h == 0 || v > 0)
                    intervals = model({a.part[v], b.part[v], c.part[v], d.part[v], e.part[v], f.part[v]});
                pixels[h] = decode(intervals, h, offsets[h], cursors[h], values[h], zeros[h]);
            }
            pack(pixels, results[i]);
            e = a;
            for (std::uint32_t v = 0; v < wave_vectors; ++v) a.part[v] = in_order(results[i][v]);
            b_before = last_b;
            last_b = b;
            last_d = next_b;
        }
        for (std::uint32_t h = 0; h < 2; ++h) {
            store_wide(state.cursors + wide_lanes * h, cursors[h]);
            store_wide(state.values + wide_lanes * h, values[h]);
            store_wide(state.zeros + wide_lanes * h, zeros[h]);
        }
        store_all(state.a, a);
        store_all(state.e, e);
        store_all(state.d, last_d);
        store_all(state.b, last_b);
        store_all(state.b_before, b_before);
    }

  private:
    // Of each 16-bit lane the prediction, and m + 256 k.
    struct Intervals {
        Lanes predictions, codes;
    };
    RECORDER_INLINE Intervals model(const LsNeighbourLanes &around) const {
        const LsLanes at = model_.apply(around);
        return {at.prediction, both(common(at.m_twice, all16(0xFF)), left16<8>(at.k_twice))};
    }

    // decode_ls_pixel of model_ls.hpp, for the lanes from 16 h on.
    RECORDER_INLINE Wide decode(const Intervals &intervals, std::uint32_t h, const BigEndianGather::Offsets &offsets,
                                Wide &cursor, Wide &values, Wide &longest) const {
        const Wide code = widened(intervals.codes, h), m = common(code, all32(0xFF)), k = right32<8>(code);
        const Wide size = left_by32(one_, m), low = sub32(widened(intervals.predictions, h), right32<1>(size));

        const Wide bits = left_by32(source_.load(offsets), common(cursor, seven_));
        const Wide zeros = sub32(leading_, exponent32(both(right32<8>(bits), sentinel_)));
        const Wide shift = choose32(bits, sub32(thirty_two_, m), sub32(thirty_one_, k));
        const Wide tail = right_by32(left_by32(bits, add32(zeros, one_)), shift);
        const Wide beyond = add32(left_by32(sub32(zeros, one_), k), right32<1>(tail));
        const Wide outside = choose32(left32<31>(tail), add32(add32(low, size), beyond), sub32(sub32(low, one_), beyond));

        const Wide is_escape = greater32(zeros, last_zeros_);
        const Wide raw = right_by32(left32<escape_prefix>(bits), escape_shift_);
        const Wide value = choose32(is_escape, raw, choose32(bits, add32(low, tail), outside));
        const Wide length = choose32(is_escape, escape_length_, sub32(add32(zeros, thirty_three_), shift));
        values = both(values, value);
        longest = max32(longest, zeros);
        cursor = min32(add32(cursor, length), limit_);
        return value;
    }

    LsModel model_;
    BigEndianGather source_;
    Lanes limit_, escape_length_, escape_shift_, middle_;
    Lanes one_ = kept(all32(1)), seven_ = kept(all32(7)), sentinel_ = kept(all32(1u << (23u - escape_prefix)));
    Lanes leading_ = kept(all32(127 + 23)), thirty_one_ = kept(all32(31)), thirty_two_ = kept(all32(32));
    Lanes thirty_three_ = kept(all32(33)), last_zeros_ = kept(all32(escape_zeros - 1));
};

class LsWave {
  public:
    LsWave(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
           StreamEnds (&streams)[written_streams])
        : header_(header),
          streams_(streams),
          decoder_(payload, header),
          rows_(image, header.width, header.height, 1, sink) {}

    bool run() {
        const std::uint32_t groups = rows_.groups(), width = header_.width;
        rows_.start_group(0);
        state_.d[0] = rows_.above()[0];
        for (std::uint32_t group = 0; group <= groups; ++group) {
            rows_.start_group(group);
            std::uint32_t x = 0;
            for (; x < edge_steps; x += wave_steps) edge(group, x);
            if (group == groups) break;
            for (; x + wave_steps < width; x += wave_steps) {
                Rows::Results results;
                decoder_.advance<wave_steps, false>(state_, rows_.above() + x + 1, rows_.above_2() + x, results, nullptr);
                rows_.put(results, x);
            }
            edge(group, x);
        }
        return sound_;
    }

  private:
    void edge(std::uint32_t group, std::uint32_t x) {
        Rows::Results results;
        for (std::uint32_t i = 0; i < wave_steps; ++i) {
            const std::uint32_t step = x + i;
            Edge at{};
            if (step < edge_steps && step % delay == 0) start(group, step / delay, at);
            const bool is_last = step + 1 == header_.width;  // of lane 0
            if (is_last) at.ends[0] = 0xFFFF;
            if (step % delay == 1 && step + 1 < edge_steps) at.ends[(step + 1) / delay] = 0xFFFF;
            const std::uint16_t right = is_last ? *rows_.next_above() : rows_.above()[step + 1];
            decoder_.advance<1, true>(state_, &right, rows_.above_2() + step, results + i, &at);
        }
        rows_.put_edge(results, x);
    }

    void start(std::uint32_t group, std::uint32_t lane, Edge &at) {
        at.starts[lane] = 0xFFFF;
        if (group == 0) {
            if (lane == 0) at.row_1[0] = 0xFFFF;
            state_.cursors[lane] = stream_of(lane).bit;
            state_.values[lane] = state_.zeros[lane] = 0;
        } else if (!rows_.exists(group, lane) && rows_.exists(group - 1, lane)) {
            StreamEnds &stream = stream_of(lane);
            stream.bit = state_.cursors[lane];
            sound_ = sound_ && stream.bit <= stream.end && state_.zeros[lane] <= escape_zeros &&
                     state_.values[lane] >> header_.depth == 0;
        }
    }

    StreamEnds &stream_of(std::uint32_t lane) { return streams_[(1 + lane) % wave_rows]; }

    const Header &header_;
    StreamEnds (&streams_)[written_streams];
    const LsDecoder decoder_;
    Rows rows_;
    State state_{};
    bool sound_ = true;
};

}  // namespace

bool decodes_ls(const Header &header) {
    return header.model == Model::felics_ls && header.streams == written_streams &&
           header.width >= edge_steps + 4 * wave_steps && header.width % wave_steps == 0 && header.height > 1 &&
           header.payload() < (std::uint64_t{1} << 28);
}

bool decode_ls_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                    StreamEnds (&streams)[written_streams]) {
    return LsWave(image, sink, payload, header, streams).run();
}

}  // namespace recorder::RECORDER_VECTOR
