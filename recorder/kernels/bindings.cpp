// The Python face of the kernels. Every loop runs without the interpreter lock.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "buffer.hpp"
#include "cpu.hpp"
#include "crc32c.hpp"
#include "error.hpp"
#include "felics.hpp"
#include "parallel.hpp"
#include "scratch.hpp"
#include "stuffing.hpp"
#include "unpack.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace recorder {
namespace {

template <typename T>
using Image = nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
template <typename T, std::size_t N>
using Output = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

struct Job {
    std::uint32_t width, height, depth;
    Model model;
    std::array<std::uint8_t, largest_table> table;
    const std::uint8_t *table_or_null;
    std::uint32_t threads;
};

void check_shape(std::size_t width, std::size_t height) {
    if (width < 1 || width > longest_side || height < 1 || height > longest_side ||
        std::uint64_t{width} * height > most_pixels)
        throw nb::value_error("an image is 1 to 65535 pixels wide and high and has at most 2^28 pixels");
}

template <typename T>
void make_job(const Image<T> &image, int depth, int model, const nb::bytes &table, Job &job) {
    const std::size_t height = image.shape(0), width = image.shape(1);
    check_shape(width, height);
    if (depth < 1 || depth > 16) throw nb::value_error("a bit depth is 1 to 16");
    if (model < 0 || model > 2) throw nb::value_error("unknown model");
    if (model == 2 && depth > static_cast<int>(deepest_ls)) throw nb::value_error("felics-ls has a bit depth of 12 at most");
    job = {static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), static_cast<std::uint32_t>(depth),
           static_cast<Model>(model), {}, nullptr, 1};
    if (table.size() == 0) return;
    if (table.size() != table_size(job.model)) throw nb::value_error("a table of another model");
    std::copy_n(reinterpret_cast<const std::uint8_t *>(table.c_str()), table.size(), job.table.begin());
    job.table_or_null = job.table.data();
}

std::uint32_t checked(int threads) {
    if (threads < 1 || threads > static_cast<int>(most_threads)) throw nb::value_error("an image is coded by 1 to 32 threads");
    return static_cast<std::uint32_t>(threads);
}

// Eight-bit images are widened first: the pixel checksum is over 16 bits.
const std::uint16_t *widen(const std::uint16_t *pixels, std::size_t, Scratch<std::uint16_t> &) { return pixels; }
const std::uint16_t *widen(const std::uint8_t *pixels, std::size_t count, Scratch<std::uint16_t> &scratch) {
    std::uint16_t *wide = scratch.reserve(count);
    std::copy_n(pixels, count, wide);
    return wide;
}

template <typename T>
std::size_t run(const Job &job, const T *pixels, std::uint8_t *target) {
    thread_local Scratch<std::uint16_t> scratch;
    const Trim trim(scratch);
    const std::uint16_t *wide = widen(pixels, std::size_t{job.width} * job.height, scratch);
    return encode(target, wide, job.width, job.height, job.depth, job.model, job.table_or_null, job.threads);
}

template <typename T>
std::size_t encode_into(const Image<T> &image, Output<std::uint8_t, 1> out, int depth, int model,
                        const nb::bytes &table, int threads) {
    Job job;
    make_job(image, depth, model, table, job);
    job.threads = checked(threads);
    if (out.shape(0) < largest_encoding(job.width, job.height, job.depth))
        throw nb::value_error("the output is smaller than max_encoded_size()");
    const T *pixels = image.data();
    std::uint8_t *target = out.data();
    nb::gil_scoped_release released;
    return run(job, pixels, target);
}

template <typename T>
nb::bytes encode_to_bytes(const Image<T> &image, int depth, int model, const nb::bytes &table, int threads) {
    thread_local Scratch<std::uint8_t> scratch;
    const Trim trim(scratch);
    Job job;
    make_job(image, depth, model, table, job);
    job.threads = checked(threads);
    const T *pixels = image.data();
    std::uint8_t *target = nullptr;
    std::size_t written = 0;
    {
        nb::gil_scoped_release released;
        target = scratch.reserve(largest_encoding(job.width, job.height, job.depth));
        written = run(job, pixels, target);
    }
    return nb::bytes(target, written);
}

template <typename T>
nb::bytes trained_table(const Image<T> &image, int depth, int model) {
    Job job;
    make_job(image, depth, model, nb::bytes("", 0), job);
    Header header;
    header.model = job.model;
    header.depth = static_cast<std::uint8_t>(job.depth);
    header.width = job.width;
    header.height = job.height;
    const T *pixels = image.data();
    {
        nb::gil_scoped_release released;
        thread_local Scratch<std::uint16_t> scratch;
        const Trim trim(scratch);
        train(header, widen(pixels, std::size_t{job.width} * job.height, scratch));
    }
    write_table(job.table.data(), header);
    return nb::bytes(job.table.data(), table_size(job.model));
}

void decode_into(nb::handle data, Output<std::uint16_t, 2> out) {
    const Buffer buffer(data);
    const Header header = parse_image(buffer.data(), buffer.size()).header;
    if (out.shape(0) != header.height || out.shape(1) != header.width) throw nb::value_error("the output has another shape");
    std::uint16_t *pixels = out.data();
    const std::uint64_t count = out.size();
    nb::gil_scoped_release released;
    decode(pixels, count, buffer.data(), buffer.size());
}

nb::tuple image_shape(nb::handle data) {
    const Buffer buffer(data);
    const Header header = parse_image(buffer.data(), buffer.size()).header;
    return nb::make_tuple(header.height, header.width);
}

nb::tuple header_fields(nb::handle data) {
    const Buffer buffer(data);
    const Header h = parse_header(buffer.data(), buffer.size()).header;
    nb::list lengths;
    for (std::uint32_t s = 0; s < h.streams; ++s) lengths.append(h.lengths[s]);
    std::array<std::uint8_t, largest_table> bytes;
    write_table(bytes.data(), h);
    const nb::bytes table(bytes.data(), table_size(h.model));
    return nb::make_tuple(format_version, static_cast<int>(h.model), h.depth, h.mask, h.width, h.height, h.checksum,
                          table, nb::tuple(lengths));
}

std::size_t find_marker(nb::handle data, std::size_t from) {
    const Buffer buffer(data);
    nb::gil_scoped_release released;
    return next_marker(buffer.data(), buffer.size(), from);
}

template <std::uint32_t (*Function)(const void *, std::size_t)>
std::uint32_t checksum(nb::handle data) {
    const Buffer buffer(data);
    nb::gil_scoped_release released;
    return Function(buffer.data(), buffer.size());
}

std::size_t largest(std::uint32_t width, std::uint32_t height, std::uint32_t depth) {
    check_shape(width, height);
    return largest_encoding(width, height, depth);
}

nb::bytes usual_table_bytes(int depth) {
    if (depth < 1 || depth > 16) throw nb::value_error("a bit depth is 1 to 16");
    const KTable table = usual_table(static_cast<std::uint32_t>(depth));
    return nb::bytes(table.data(), table.size());
}

void mono10p(nb::handle data, nb::ndarray<std::uint16_t, nb::c_contig, nb::device::cpu> out) {
    const Buffer buffer(data);
    if (buffer.size() != (10 * out.size() + 7) / 8)
        throw nb::value_error("Mono10p data must have ten bits for every pixel of the output");
    std::uint16_t *pixels = out.data();
    const std::size_t count = out.size();
    nb::gil_scoped_release released;
    unpack_mono10p(pixels, count, buffer.data());
}

// Called first at import: what is wrong with RECORDER_KERNELS becomes the ImportError.
const char *set_name() {
    try {
        return name_of(instruction_set());
    } catch (const ArgumentError &error) {
        throw std::runtime_error(error.what);
    }
}

void translate(const std::exception_ptr &pointer, void *payload) {
    try {
        std::rethrow_exception(pointer);
    } catch (const FormatError &error) {
        PyObject *arguments = Py_BuildValue("(sn)", error.what, static_cast<Py_ssize_t>(error.offset));
        if (arguments == nullptr) return;
        PyErr_SetObject(static_cast<PyObject *>(payload), arguments);
        Py_DECREF(arguments);
    } catch (const ArgumentError &error) {
        PyErr_SetString(PyExc_ValueError, error.what);
    }
}

}  // namespace
}  // namespace recorder

NB_MODULE(_kernels, m) {
    using namespace recorder;
    set_name();
    nb::object format_error = nb::steal(PyErr_NewException("recorder.kernels.FormatError", PyExc_ValueError, nullptr));
    m.attr("FormatError") = format_error;
    nb::register_exception_translator(translate, format_error.ptr());

    m.def("felics_encode", encode_to_bytes<std::uint16_t>, nb::arg("image").noconvert(), "depth"_a, "model"_a, "table"_a,
          "threads"_a = 1);
    m.def("felics_encode", encode_to_bytes<std::uint8_t>, nb::arg("image").noconvert(), "depth"_a, "model"_a, "table"_a,
          "threads"_a = 1);
    m.def("felics_encode_into", encode_into<std::uint16_t>, nb::arg("image").noconvert(), nb::arg("out").noconvert(),
          "depth"_a, "model"_a, "table"_a, "threads"_a = 1);
    m.def("felics_encode_into", encode_into<std::uint8_t>, nb::arg("image").noconvert(), nb::arg("out").noconvert(),
          "depth"_a, "model"_a, "table"_a, "threads"_a = 1);
    m.def("felics_train", trained_table<std::uint16_t>, nb::arg("image").noconvert(), "depth"_a, "model"_a);
    m.def("felics_train", trained_table<std::uint8_t>, nb::arg("image").noconvert(), "depth"_a, "model"_a);
    m.def("felics_largest_encoding", largest, "width"_a, "height"_a, "depth"_a);
    m.def("felics_usual_table", usual_table_bytes, "depth"_a);
    m.def("felics_header", header_fields, "data"_a);
    m.def("felics_shape", image_shape, "data"_a);
    m.def("felics_decode_into", decode_into, "data"_a, nb::arg("out").noconvert());
    m.def("instruction_set", set_name);
    m.def("find_marker", find_marker, "data"_a, "start"_a);
    m.def("crc32c", checksum<crc32c>, "data"_a);
    m.def("crc32c_portable", checksum<crc32c_portable>, "data"_a);
    m.def("unpack_mono10p", mono10p, "data"_a, nb::arg("out").noconvert());
}
