// What both models' code words share, in 16-bit lanes: the choice between inside, outside and escape.
#pragma once

#include "append_vector.hpp"
#include "code.hpp"
#include "lanes.hpp"

namespace recorder::RECORDER_VECTOR {

class CodeAssembler {
  public:
    explicit CodeAssembler(std::uint32_t depth)
        : escape_one_(kept(all16(1u << depth))), escape_length_(kept(all16(longest_code(depth)))) {}

    // `distance` is zero inside; `above` is 1 above the interval and 0 below it. Numbers with "_twice" hold the
    // same byte twice, as table indices do.
    RECORDER_INLINE Codes assemble(const Powers &powers, Lanes x, Lanes is_inside, const Codes &inside,
                                   Lanes distance, Lanes above, Lanes k_twice) const {
        // The prefix, the remainder and the side; the zeros before it are only counted.
        const Lanes divisor = powers.power(k_twice);
        const Lanes quotient = powers.divided(distance, k_twice);
        const Lanes half = add16(divisor, common(distance, sub16(divisor, one_)));
        const Lanes outside_value = add16(add16(half, half), above);
        const Lanes outside_length = add16(add16(common(k_twice, low_byte_), quotient), three_);

        const Lanes value = choose(is_inside, inside.values, outside_value);
        const Lanes length = choose(is_inside, inside.lengths, outside_length);
        const Lanes is_escape = greater16(quotient, last_quotient_);
        return {choose(is_escape, both(x, escape_one_), value), choose(is_escape, escape_length_, length)};
    }

  private:
    Lanes escape_one_, escape_length_;
    Lanes one_ = kept(all16(1)), three_ = kept(all16(3)), low_byte_ = kept(all16(0xFF));
    Lanes last_quotient_ = kept(all16(escape_zeros - 2));
};

}  // namespace recorder::RECORDER_VECTOR
