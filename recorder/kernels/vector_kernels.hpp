// The kernels that are compiled once for each set of vector instructions, and the choice of a set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "bits.hpp"
#include "felics.hpp"
#include "ls_lines.hpp"

namespace recorder {

// Up to this depth every code word's value fits 16 bits.
constexpr std::uint32_t deepest_encoded = 14;

// Appends one row of the model felics that has a row above it, and returns `crc` (a running CRC-32C register)
// moved on over its pixels. All pixels are below 2^depth, which is deepest_encoded at most. Reads the pixel
// before the row, which is the row above's last.
using EncodeRow = std::uint32_t(BitWriter &writer, const std::uint16_t *row, std::uint32_t width,
                                std::uint32_t depth, const KTable &table, std::uint32_t crc);

// The same for the newest row of `lines` by the model felics-ls; its pixels also stand at `row`.
using EncodeLsRow = std::uint32_t(BitWriter &writer, const LsLines &lines, const std::uint16_t *row,
                                  std::uint32_t width, bool two_above, std::uint32_t depth, const LsTable &table,
                                  std::uint32_t crc);

// Appends the pixels of a row as they are, up to deepest_encoded bits each.
using PackRow = void(BitWriter &writer, const std::uint16_t *row, std::uint32_t width, std::uint32_t depth);

// All pixels' bits together.
using BitsInUse = std::uint32_t(const std::uint16_t *row, std::uint32_t width);

// Where a stream is read and where it ends, both in bits of the unstuffed payload.
struct StreamEnds {
    std::uint32_t bit, end;
};

// Whether the DecodeRows of a model can be used.
using Decodes = bool(const Header &header);

// Decodes all rows but the topmost, whose stream stands behind it in `streams`, and moves the streams on.
// False if anything is wrong: then the pixels and streams are void. `sink` has room for one row. May read 16
// bytes behind the payload, which are to be zero.
using DecodeRows = bool(std::uint16_t *image, std::uint16_t *sink, const std::uint8_t *payload,
                        const Header &header, StreamEnds (&streams)[written_streams]);

// What is still to be done of a stuffing or unstuffing, moved on by the functions below; they leave the last
// bytes, fewer than a vector has, to the caller.
struct Span {
    std::uint8_t *target;
    const std::uint8_t *source;
    std::size_t size;  // bytes of source
};

// Stuffs XORed bytes. False if more than `extra` bytes had to be added, which counts down.
using Stuff = bool(Span &span, std::uint8_t mask, std::size_t &extra);

// Unstuffs; stops early at an FF that no 00 follows.
using Unstuff = void(Span &span, std::uint8_t mask);

struct VectorKernels {
    std::uint32_t narrowest_encoded;  // a narrower image is no work for EncodeRow and EncodeLsRow
    EncodeRow *encode_row;
    EncodeLsRow *encode_ls_row;
    PackRow *pack_row;
    BitsInUse *bits_in_use;
    Decodes *decodes, *decodes_ls;
    DecodeRows *decode_rows, *decode_ls_rows;
    Stuff *stuff;
    Unstuff *unstuff;
};

// The widest set that the process may use (cpu.hpp), or null: then there is only the portable code.
const VectorKernels *vector_kernels();

}  // namespace recorder
