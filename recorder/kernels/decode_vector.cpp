#include "vector_set.hpp"

#include <algorithm>

#include "wavefront_vector.hpp"
#include "wide.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

// What the lanes know from step to step.
struct State {
    alignas(sizeof(Lanes)) std::uint32_t cursors[wave_rows];  // in bits
    alignas(sizeof(Lanes)) std::uint32_t lefts[wave_rows];
    alignas(sizeof(Lanes)) std::uint32_t values[wave_rows];  // all values so far, ored: no bit is above the depth
    alignas(sizeof(Lanes)) std::uint32_t zeros[wave_rows];   // the longest run of zeros so far
};

// decode_pixel of code.hpp.
class PixelDecoder {
  public:
    PixelDecoder(const std::uint8_t *payload, std::size_t size, const Header &header)
        : source_(payload),
          limit_(kept(all32(static_cast<std::uint32_t>(8 * size) + 64u))),
          escape_length_(kept(all32(longest_code(header.depth)))),
          escape_shift_(kept(all32(32u - header.depth))),
          k_(kept(table16(header.table.data()))) {}

    RECORDER_INLINE void prepare(BigEndianGather::Offsets &offsets, const Wide &cursor) const {
        BigEndianGather::prepare(offsets, right32<3>(cursor));
    }
    RECORDER_INLINE Wide decode(const BigEndianGather::Offsets &offsets, Wide &cursor, const Wide &left, const Wide &top, Wide &values, Wide &longest) const {
        const Wide low = min32(left, top), high = max32(left, top);
        const Wide size = sub32(sub32(high, low), minus_one_);
        const Wide biased = exponent32(size), context = sub32(biased, bias_);
        const Wide short_codes = sub32(left_by32(two_, context), size);
        const Wide k = look_up(k_, add32(biased, index_bias_));

        // At least 25 bits: the longest code word. A sentinel ends the run of zeros at ten.
        const Wide bits = left_by32(source_.load(offsets), common(cursor, seven_));
        const Wide exponent = exponent32(both(right32<8>(bits), sentinel_));
        const Wide zeros = sub32(leading_, exponent);
        const Wide tail_length = choose32(bits, context, k);
        const Wide tail = right_by32(left_by32(bits, sub32(zeros, minus_one_)), sub32(thirty_one_, tail_length));
        const Wide half = right32<1>(tail);

        const Wide is_short = greater32(short_codes, half);
        const Wide inside = add32(low, choose32(is_short, half, sub32(tail, short_codes)));
        const Wide beyond = sub32(add32(left_by32(add32(zeros, minus_one_), k), half), minus_one_);
        const Wide outside = choose32(left32<31>(tail), add32(high, beyond), sub32(low, beyond));
        const Wide saved = common(is_short, signed_right32<31>(bits));
        const Wide length = add32(add32(add32(zeros, two_), tail_length), saved);

        const Wide is_escape = greater32(zeros, last_zeros_);
        const Wide raw = right_by32(left32<escape_prefix>(bits), escape_shift_);
        const Wide value = choose32(is_escape, raw, choose32(bits, inside, outside));
        values = both(values, value);
        longest = max32(longest, zeros);
        cursor = min32(add32(cursor, choose32(is_escape, escape_length_, length)), limit_);
        return value;
    }

  private:
    BigEndianGather source_;
    Lanes limit_, escape_length_, escape_shift_, k_;
    Lanes seven_ = kept(all32(7)), sentinel_ = kept(all32(1u << (23u - escape_prefix)));
    Lanes bias_ = kept(all32(127)), leading_ = kept(all32(127 + 23)), minus_one_ = kept(all32(~0u));
    Lanes index_bias_ = kept(all32(0x80808000u - 127u));  // and zero for the three upper bytes of each lane
    Lanes two_ = kept(all32(2)), thirty_one_ = kept(all32(31)), last_zeros_ = kept(all32(escape_zeros - 1));
};

using Rows = WaveRows<1>;

// `steps` steps; lane 0 reads its upper neighbours from `above`. In an edge step (then there is one) the lane
// that `starting` marks is at the start of its row.
template <std::uint32_t steps, bool edge>
RECORDER_INLINE void advance(const PixelDecoder &decoder, State &state, const std::uint16_t *above,
                             Lanes (*results)[wave_vectors], const std::uint32_t *starting) {
    Wide cursors[2], lefts[2], values[2], zeros[2];
    for (std::uint32_t h = 0; h < 2; ++h) {
        cursors[h] = load_wide(state.cursors + wide_lanes * h);
        lefts[h] = load_wide(state.lefts + wide_lanes * h);
        values[h] = load_wide(state.values + wide_lanes * h);
        zeros[h] = load_wide(state.zeros + wide_lanes * h);
    }
    for (std::uint32_t i = 0; i < steps; ++i) {
        BigEndianGather::Offsets offsets[2];
        Wide tops[2] = {shifted_up32(all32(above[i]), lefts[0]), shifted_up32(lefts[0].part[wide_parts - 1], lefts[1])};
#pragma GCC unroll 2
        for (std::uint32_t h = 0; h < 2; ++h) decoder.prepare(offsets[h], cursors[h]);
#pragma GCC unroll 2
        for (std::uint32_t h = 0; h < 2; ++h) {
            if (edge) lefts[h] = choose32(load_wide(starting + wide_lanes * h), tops[h], lefts[h]);
            lefts[h] = decoder.decode(offsets[h], cursors[h], lefts[h], tops[h], values[h], zeros[h]);
        }
        pack(lefts, results[i]);
    }
    for (std::uint32_t h = 0; h < 2; ++h) {
        store_wide(state.cursors + wide_lanes * h, cursors[h]);
        store_wide(state.lefts + wide_lanes * h, lefts[h]);
        store_wide(state.values + wide_lanes * h, values[h]);
        store_wide(state.zeros + wide_lanes * h, zeros[h]);
    }
}

// Thirty-two numbers of these from number 32 - j on mark lane j.
constexpr std::array<std::uint32_t, 2 * wave_rows> make_starts() {
    std::array<std::uint32_t, 2 * wave_rows> starts{};
    starts[wave_rows] = ~0u;
    return starts;
}
constexpr std::array<std::uint32_t, 2 * wave_rows> starts = make_starts();

class Wave {
  public:
    Wave(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
         StreamEnds (&streams)[written_streams])
        : header_(header),
          streams_(streams),
          decoder_(payload, static_cast<std::size_t>(header.payload()), header),
          rows_(image, header.width, header.height, 1, sink) {}

    bool run() {
        const std::uint32_t groups = rows_.groups();
        for (std::uint32_t group = 0; group <= groups; ++group) {
            rows_.start_group(group);
            std::uint32_t x = 0;
            for (; x < wave_rows; x += wave_steps) edge(group, x);
            if (group == groups) break;
            for (; x < header_.width; x += wave_steps) {
                Rows::Results results;
                advance<wave_steps, false>(decoder_, state_, rows_.above() + x, results, nullptr);
                rows_.put(results, x);
            }
        }
        return sound_;
    }

  private:
    // Eight steps in each of which one lane starts its row: lane x at the first.
    void edge(std::uint32_t group, std::uint32_t x) {
        Rows::Results results;
        for (std::uint32_t i = 0; i < wave_steps; ++i) {
            const std::uint32_t lane = x + i;
            if (group == 0) {
                state_.cursors[lane] = stream_of(lane).bit;
                state_.values[lane] = state_.zeros[lane] = 0;
            } else if (!rows_.exists(group, lane) && rows_.exists(group - 1, lane)) {
                finish(lane);
            }
            advance<1, true>(decoder_, state_, rows_.above() + lane, results + i, starts.data() + wave_rows - lane);
        }
        rows_.put_edge(results, x);
    }

    void finish(std::uint32_t lane) {
        StreamEnds &stream = stream_of(lane);
        stream.bit = state_.cursors[lane];
        sound_ = sound_ && stream.bit <= stream.end && state_.zeros[lane] <= escape_zeros &&
                 state_.values[lane] >> header_.depth == 0;
    }

    StreamEnds &stream_of(std::uint32_t lane) { return streams_[(1 + lane) % wave_rows]; }

    const Header &header_;
    StreamEnds (&streams_)[written_streams];
    const PixelDecoder decoder_;
    Rows rows_;
    State state_{};
    bool sound_ = true;
};

}  // namespace

bool decodes(const Header &header) {
    // 25 bits hold the longest code word, and lane 31 has stored what lane 0 needs as its row above.
    return header.model == Model::felics && header.streams == written_streams && longest_code(header.depth) <= 25 &&
           header.width >= 2 * wave_rows && header.width % wave_steps == 0 && header.height > 1 &&
           header.payload() < (std::uint64_t{1} << 28);
}

bool decode_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                 StreamEnds (&streams)[written_streams]) {
    return Wave(image, sink, payload, header, streams).run();
}

}  // namespace recorder::RECORDER_VECTOR
