#include "vector_set.hpp"

#include "wavefront_vector.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

// Interval of code.hpp.
class FelicsModel {
  public:
    static constexpr std::uint32_t delay = 1;

    explicit FelicsModel(const Header &header) : k_(kept(table16(header.table.data()))) {
        alignas(16) std::uint8_t shifts[16], biased[16];
        for (std::uint32_t c = 0; c < 16; ++c) {
            shifts[c] = static_cast<std::uint8_t>(30u - c);
            biased[c] = static_cast<std::uint8_t>(header.table[c] + outside_bias);
        }
        inside_shifts_ = kept(table16(shifts));
        k_biased_ = kept(table16(biased));
    }

    struct History {
        WaveLanes left;
    };
    struct Around {
        WaveLanes left, top;
    };
    void start(History &, const Above &) const {}
    template <bool edge>
    RECORDER_INLINE Around around(const History &history, const Above &above, const Edge *at) const {
        Around around{history.left, from_above(above.b, history.left)};
        if (edge) around.left = choose(load_rows(at->starts), around.top, around.left);
        return around;
    }
    RECORDER_INLINE void next(History &history, const WaveLanes &values) const { history.left = values; }

    struct Interval {
        CodeLanes code;
        Lanes short_limit;            // half a word inside is less if it is short
        Lanes from_short, from_long;  // what is added to half a short word, to a long one
    };
    RECORDER_INLINE Interval interval(const Around &around, std::uint32_t h) const {
        const Lanes left = around.left.part[h], top = around.top.part[h];
        const Lanes low = min16(left, top), size = add16(sub16(max16(left, top), low), all16(1));
        const Lanes context_twice = powers_.log2_twice(size), power = powers_.power(context_twice);
        const Lanes index = both(context_twice, all16(0x8000));  // so that upper bytes become zero
        // The word is 2^(c+1) + tail, the half of it 2^c + floor(tail / 2), and t = 2^(c+1) - size.
        const Lanes short_limit = sub16(add16(add16(power, power), power), size), from_short = sub16(low, power);
        return {{low, size, look_up(inside_shifts_, index), powers_.power(look_up(k_, context_twice)),
                 look_up(k_biased_, index)},
                short_limit, from_short, sub16(from_short, short_limit)};
    }
    RECORDER_INLINE auto inside(const Interval &interval) const {
        return [&interval](Lanes word) -> Inside {
            const Lanes half = right16<1>(word);
            // tail - t is above floor(tail / 2) just if the code is long.
            return {signed_max16(add16(half, interval.from_short), add16(word, interval.from_long)),
                    sub16(interval.code.inside_shift, greater16(interval.short_limit, half))};
        };
    }

  private:
    Powers powers_;
    Lanes k_, inside_shifts_, k_biased_;
};

}  // namespace

bool decodes(const Header &header) {
    // The last row of a group has stored what the first one of the next group needs above it.
    return header.model == Model::felics && header.streams == written_streams && header.depth <= deepest_decoded &&
           header.width >= 2 * wave_rows && header.width % wave_steps == 0 && header.height > 1 &&
           header.payload() < (std::uint64_t{1} << 28);
}

bool decode_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                 StreamEnds (&streams)[written_streams]) {
    return Wave<FelicsModel>(image, sink, payload, header, streams).run();
}

}  // namespace recorder::RECORDER_VECTOR
