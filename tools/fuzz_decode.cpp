// libFuzzer target: any bytes, decoded, are the same picture or the same error with every set of instructions.
// The mutator takes images apart and puts them together again with checksums, lengths and stuffing that mostly
// hold, so that what is changed behind them is really looked at; it starts from pictures of its own, and needs no
// corpus.
#include <random>

#include "crc32c.hpp"
#include "fuzz.hpp"

using namespace recorder;

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t *data, std::size_t size, std::size_t room);

namespace {

using Random = std::mt19937;

std::uint32_t word(Random &random) { return static_cast<std::uint32_t>(random()); }

std::uint32_t below(Random &random, std::size_t limit) {
    return static_cast<std::uint32_t>(std::uniform_int_distribution<std::size_t>(0, limit - 1)(random));
}

std::uint32_t one_of(Random &random, std::initializer_list<std::uint32_t> values) {
    return values.begin()[below(random, values.size())];
}

std::uint32_t number(const std::uint8_t *at, unsigned bytes) {
    std::uint32_t value = 0;
    for (unsigned i = 0; i < bytes; ++i) value |= std::uint32_t{at[i]} << (8 * i);
    return value;
}

void put(Bytes &bytes, std::uint32_t value, unsigned count) {
    for (; count > 0; --count, value >>= 8) bytes.push_back(static_cast<std::uint8_t>(value));
}

void mutate(Bytes &bytes, std::size_t room) {
    if (room == 0) return;
    const std::size_t size = bytes.size();
    bytes.resize(std::max(size, room));
    bytes.resize(LLVMFuzzerMutate(bytes.data(), size, bytes.size()));
}

// An image taken apart; anything can be made wrong before it is put together.
struct Parts {
    std::uint32_t version = format_version, model = 0, depth = 1, mask = 0, width = 1, height = 1, checksum = 0;
    Bytes table;
    std::vector<Bytes> streams;
    // Added to the number of streams, the table's length, the first stream's length and the header's checksum.
    std::uint32_t wrong_count = 0, wrong_table = 0, wrong_length = 0, wrong_checksum = 0;

    // Nothing of it needs to hold but that there are enough bytes.
    static bool take_apart(const std::uint8_t *data, std::size_t size, Parts &parts) {
        Bytes body;
        for (std::size_t i = marker_size; i + marker_size < size; ++i) {
            body.push_back(data[i]);
            if (data[i] == marker_prefix && data[i + 1] == 0) ++i;
        }
        if (body.size() < header_fixed_size) return false;
        const std::uint8_t *at = body.data();
        const std::uint32_t count = number(at + 12, 2), table = number(at + 18, 2);
        const std::size_t begin = header_fixed_size + table + 4 * std::size_t{count} + 4;
        if (body.size() < begin || count > most_streams) return false;
        parts.version = at[0];
        parts.model = at[1];
        parts.depth = at[2];
        parts.mask = at[3];
        parts.width = number(at + 4, 4);
        parts.height = number(at + 8, 4);
        parts.checksum = number(at + 14, 4);
        at += header_fixed_size;
        parts.table.assign(at, at + table);
        at += table;
        auto from = body.begin() + static_cast<std::ptrdiff_t>(begin);
        for (std::uint32_t s = 0; s < count; ++s, at += 4) {
            const auto length = std::min<std::ptrdiff_t>(number(at, 4), body.end() - from);
            Bytes stream(from, from + length);
            for (std::uint8_t &byte : stream) byte = static_cast<std::uint8_t>(byte ^ parts.mask);
            parts.streams.push_back(std::move(stream));
            from += length;
        }
        return true;
    }

    Bytes join() const {
        Bytes body;
        put(body, version, 1);
        put(body, model, 1);
        put(body, depth, 1);
        put(body, mask, 1);
        put(body, width, 4);
        put(body, height, 4);
        put(body, static_cast<std::uint32_t>(streams.size()) + wrong_count, 2);
        put(body, checksum, 4);
        put(body, static_cast<std::uint32_t>(table.size()) + wrong_table, 2);
        body.insert(body.end(), table.begin(), table.end());
        std::uint32_t wrong = wrong_length;
        for (const Bytes &stream : streams) {
            put(body, static_cast<std::uint32_t>(stream.size()) + wrong, 4);
            wrong = 0;
        }
        put(body, crc32c(body.data(), body.size()) + wrong_checksum, 4);
        for (const Bytes &stream : streams)
            for (const std::uint8_t byte : stream) body.push_back(static_cast<std::uint8_t>(byte ^ mask));

        Bytes image = {marker_prefix, start_of_image};
        for (const std::uint8_t byte : body) {
            image.push_back(byte);
            if (byte == marker_prefix) image.push_back(0);
        }
        image.push_back(marker_prefix);
        image.push_back(end_of_image);
        return image;
    }

    std::size_t pixels_of(std::size_t stream) const {
        const std::size_t count = streams.size();
        return stream < height ? (height - stream + count - 1) / count * width : 0;
    }

    // Every k and m is at most the depth.
    void limit_table() {
        const std::uint32_t most = std::min(depth, 15u);
        const bool two = model == static_cast<std::uint32_t>(Model::felics_ls);
        for (std::size_t i = 0; i < table.size() && (!two || i < ls_contexts); ++i) {
            const std::uint32_t entry = table[i], m = std::min(entry & 15u, most), k = std::min(entry >> 4, most);
            table[i] = static_cast<std::uint8_t>(two ? m | k << 4 : std::min(entry, most));
        }
    }
};

// A picture's payload: any bytes, about as many as its pixels may need.
Parts any_image(Random &random) {
    Parts parts;
    parts.model = below(random, 3);
    parts.depth = 1u + below(random, parts.model == 2 ? deepest_ls : 16);
    parts.mask = one_of(random, {0, usual_mask, 255});
    parts.width = one_of(random, {1, 2, 1u + below(random, 50), 64, 72, 96, 104, 136});
    parts.height = one_of(random, {1, 2, 3, 33, 34, 1u + below(random, 70)});
    parts.table.resize(table_size(static_cast<Model>(parts.model)));
    for (std::uint8_t &byte : parts.table) byte = static_cast<std::uint8_t>(random());
    parts.limit_table();
    parts.streams.resize(one_of(random, {written_streams, written_streams, written_streams, 1, 2, 5, most_streams}));
    const std::uint32_t ones = one_of(random, {0, 1, 2, 3, 255});  // half, many, more, and nothing else
    for (std::size_t s = 0; s < parts.streams.size(); ++s) {
        const std::size_t least = parts.pixels_of(s), bits = parts.model == 0 ? least * parts.depth : least;
        parts.streams[s].resize((bits + 7) / 8);
        for (std::uint8_t &byte : parts.streams[s]) {
            byte = static_cast<std::uint8_t>(random());
            for (std::uint32_t i = 0; i < ones && byte < 255; ++i) byte = static_cast<std::uint8_t>(byte | random());
        }
    }
    return parts;
}

void change_header(Random &random, Parts &parts) {
    const std::uint32_t any = one_of(random, {0, 1, 2, 3, 16, 17, 255, 65535, 65536, 1u << 28, ~0u, word(random)});
    switch (below(random, 12)) {
        case 0: parts.version = any; break;
        case 1: parts.model = any; break;
        case 2: parts.depth = any; break;
        case 3: parts.mask = any; break;
        case 4: parts.width = any; break;
        case 5: parts.height = any; break;
        case 6: parts.checksum = any; break;
        case 7: parts.streams.resize(any % (most_streams + 2)); break;
        case 8: parts.wrong_count = any; break;
        case 9: parts.wrong_table = any; break;
        case 10: parts.wrong_length = one_of(random, {1, ~0u, any}); break;
        default: parts.wrong_checksum = any; break;
    }
}

void change_payload(Random &random, Parts &parts) {
    if (parts.streams.empty()) return;
    Bytes &stream = parts.streams[below(random, parts.streams.size())];
    switch (below(random, 5)) {
        case 0: stream.push_back(static_cast<std::uint8_t>(one_of(random, {0, 255, word(random)}))); break;
        case 1: stream.resize(below(random, stream.size() + 1)); break;
        case 2: stream = parts.streams[below(random, parts.streams.size())]; break;
        case 3:  // more zeros than any code word has, and room for what they displace
            for (std::size_t i = below(random, stream.size() + 1), end = i + 2; i < std::min(end, stream.size()); ++i) stream[i] = 0;
            stream.insert(stream.end(), 1 + below(random, 8 + 4 * stream.size()), 255);
            break;
        default: mutate(stream, stream.size() + 8);
    }
}

// Follows what the decoder complains of until it finds nothing more: any payload becomes a picture's.
void mend(Random &random, Parts &parts) {
    for (int i = 0; i < 300; ++i) {
        const Bytes image = parts.join();
        const Outcome result = decode(image.data(), image.size());
        if (result.failed_by("the pixels' checksum is wrong")) {
            parts.checksum = crc32c(result.pixels.data(), 2 * result.pixels.size());
            continue;
        }
        const bool early = result.failed_by("a stream ends early");
        const bool left = result.failed_by("bytes are left over in a stream");
        const bool padded = result.failed_by("a stream is padded with ones");
        const bool none = result.failed_by("a code that means no pixel");
        if (!early && !left && !padded && !none) break;

        // The byte of the payload, and the stream that it is in or, for one that ends early, that it is behind.
        std::size_t at = parse_header(image.data(), image.size()).end, byte = 0, s = 0;
        for (; at < result.offset; ++at, ++byte)
            if (image[at] == marker_prefix) ++at;
        for (; s + 1 < parts.streams.size(); ++s) {
            const std::size_t length = parts.streams[s].size();
            if (length > 0 && byte < length + (early ? 1 : 0)) break;
            byte -= length;
        }
        Bytes &stream = parts.streams[s];
        if (stream.empty()) break;
        byte = std::min(byte, stream.size() - 1);
        const auto mostly_ones = static_cast<std::uint8_t>(random() | random() | random());
        if (early) stream.insert(stream.end(), 1 + stream.size() / 8, mostly_ones);
        if (left) stream.resize(byte);
        if (padded) stream.back() = static_cast<std::uint8_t>(stream.back() & (stream.back() - 1u));
        if (none) stream[byte] = static_cast<std::uint8_t>(stream[byte] | (128u >> below(random, 8)));
    }
}

// Unstuffing alone, into exactly as much memory as it may need.
struct Unstuffed {
    Bytes bytes;
    std::size_t error_offset = 0;
    bool operator==(const Unstuffed &other) const {
        return bytes == other.bytes && error_offset == other.error_offset;
    }
};

// Of what stands behind the start marker, or would.
void check_stuffing(const std::uint8_t *data, std::size_t size) {
    const std::size_t begin = std::min(size, marker_size), count = size - begin;
    const std::uint8_t *stuffed = data + begin;
    with_every_set("all sets unstuff alike", [&] {
        const std::unique_ptr<std::uint8_t[]> target(new std::uint8_t[count]);
        Unstuffed result;
        try {
            const std::size_t written = unstuff(target.get(), stuffed, count, usual_mask, begin);
            result.bytes.assign(target.get(), target.get() + written);
            require(stuffed_position(stuffed, count, written) == count, "the end is behind the last byte");
        } catch (const FormatError &error) {
            result.error_offset = error.offset;
            require(data[error.offset] == marker_prefix, "an error is at an FF");
        }
        return result;
    });
}

void check_finding(const std::uint8_t *data, std::size_t size) {
    std::size_t expected = 0;
    while (expected < size && !(data[expected] == marker_prefix && expected + 1 < size &&
                                (data[expected + 1] == start_of_image || data[expected + 1] == end_of_image)))
        ++expected;
    require(next_marker(data, size, 0) == expected, "the next marker is the first");
    require(crc32c(data, size) == crc32c_portable(data, size), "both checksums are the same");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
    check_stuffing(data, size);
    check_finding(data, size);
    const Bytes image(data, data + size);
    const Outcome result = decode_with_every_set(image);
    if (result.error != nullptr) return 0;

    // What is a picture can be coded anew.
    const Header header = parse_image(data, size).header;
    const Bytes again =
        encode_with_every_set(result.pixels, header.width, header.height, header.depth, header.model, nullptr);
    require(decode_with_every_set(again) == result, "coded anew, it is the same picture");
    return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t *data, std::size_t size, std::size_t room, unsigned seed) {
    Random random(seed);
    if (below(random, 8) == 0) return LLVMFuzzerMutate(data, size, room);
    Parts parts;
    if (below(random, 16) == 0 || !Parts::take_apart(data, size, parts)) parts = any_image(random);
    do {
        switch (below(random, 6)) {
            case 0: change_header(random, parts); break;
            case 1: mutate(parts.table, parts.table.size()); break;
            default: change_payload(random, parts);
        }
    } while (below(random, 3) == 0);
    if (below(random, 4) != 0) parts.limit_table();
    if (below(random, 2) == 0) mend(random, parts);
    Bytes image = parts.join();
    if (below(random, 16) == 0) {  // cut off, perhaps behind an FF, and perhaps with an end
        image.resize(below(random, image.size()));
        if (below(random, 2) == 0) image.push_back(marker_prefix);
        if (below(random, 2) == 0) image.insert(image.end(), {marker_prefix, end_of_image});
    }
    if (image.size() > room) return LLVMFuzzerMutate(data, size, room);
    std::copy(image.begin(), image.end(), data);
    return image.size();
}
