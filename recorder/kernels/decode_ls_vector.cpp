#include "vector_set.hpp"

#include "model_ls_vector.hpp"
#include "wavefront_vector.hpp"

namespace recorder::RECORDER_VECTOR {
namespace {

// LsInterval of model_ls.hpp.
class LsWaveModel {
  public:
    static constexpr std::uint32_t delay = 2;  // a row needs its upper right neighbour

    explicit LsWaveModel(const Header &header)
        : model_(header.ls_table, header.depth), middle_(kept(all16(1u << (header.depth - 1u)))) {}

    // Named as in the model, of the pixel decoded last: d is the next one's b, b the next one's c.
    struct History {
        WaveLanes a, e, d, b, b_before;
    };
    struct Around {
        WaveLanes a, b, c, d, e, f;
    };
    void start(History &history, const Above &above) const {
        alignas(32) std::uint16_t first[wave_rows] = {};
        first[lane_of(0)] = *above.b;
        history.d = load_rows(first);
    }
    template <bool edge>
    RECORDER_INLINE Around around(History &history, const Above &above, const Edge *at) const {
        const WaveLanes next_b = from_above(above.d, history.a);
        Around n{history.a, history.d, history.b, next_b, history.e, from_above(above.f, history.b_before)};
        if (edge) {
            const WaveLanes starts = load_rows(at->starts), row_1 = load_rows(at->row_1);
            n.a = choose(starts, n.b, n.a);
            n.e = choose(starts, n.b, n.e);
            n.c = choose(starts, choose(row_1, {{middle_, middle_}}, n.f), n.c);
            n.d = choose(load_rows(at->ends), n.b, n.d);
        }
        history = {history.a, n.a, next_b, n.b, history.b};
        return n;
    }
    RECORDER_INLINE void next(History &history, const WaveLanes &values) const { history.a = values; }

    struct Interval {
        CodeLanes code;
    };
    RECORDER_INLINE Interval interval(const Around &n, std::uint32_t h) const {
        const LsLanes at =
            model_.apply({n.a.part[h], n.b.part[h], n.c.part[h], n.d.part[h], n.e.part[h], n.f.part[h]});
        const Lanes size = powers_.power(at.m_twice), low_byte = all16(0xFF);
        return {{sub16(at.prediction, right16<1>(size)), size, sub16(all16(31), common(at.m_twice, low_byte)),
                 powers_.power(at.k_twice), add16(common(at.k_twice, low_byte), all16(outside_bias))}};
    }
    RECORDER_INLINE auto inside(const Interval &interval) const {
        return [&code = interval.code](Lanes word) -> Inside {
            return {add16(sub16(word, code.size), code.low), code.inside_shift};
        };
    }

  private:
    Powers powers_;
    LsModel model_;
    Lanes middle_;
};

}  // namespace

bool decodes_ls(const Header &header) {
    return header.model == Model::felics_ls && header.streams == written_streams &&
           header.width >= LsWaveModel::delay * wave_rows + 4 * wave_steps && header.width % wave_steps == 0 &&
           header.height > 1 && header.payload() < (std::uint64_t{1} << 28);
}

bool decode_ls_rows(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload, const Header &header,
                    StreamEnds (&streams)[written_streams]) {
    return Wave<LsWaveModel>(image, sink, payload, header, streams).run();
}

}  // namespace recorder::RECORDER_VECTOR
