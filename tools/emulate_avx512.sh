#!/bin/sh
# Encodes and decodes pictures with every set of instructions, all of which must agree, on a processor that lacks
# AVX-512: SIMDe (Debian's libsimde-dev) stands for it. What is checked is in fuzz_encode.cpp.
# usage: emulate_avx512.sh PICTURES
set -eu
pictures=$1
root=$(cd "$(dirname "$0")/.." && pwd)
kernels=$root/recorder/kernels
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
avx2="-mavx2 -mbmi -mbmi2 -mlzcnt -mmovbe"
emulated="$avx2 -isystem $root/tools/emulated_avx512 -Wno-psabi -DRECORDER_AVX512"

for source in "$root"/tools/emulate_avx512.cpp "$root"/tools/fuzz_encode.cpp "$root"/tools/fuzz_sets.cpp \
    "$kernels"/*.cpp; do
    name=$(basename "$source" .cpp)
    case $name in
        bindings | cpu | vector_kernels) ;; # fuzz_sets stands for the last two
        decode*_vector) echo "$avx2 -c $source -o $build/$name.o" ;;
        *_vector)
            echo "$avx2 -c $source -o $build/$name.o"
            echo "$emulated -c $source -o $build/$name.emulated.o"
            ;;
        *) echo "-DRECORDER_EMULATED_AVX512 -c $source -o $build/$name.o" ;;
    esac
done | xargs -P "$(nproc)" -L 1 "${CXX:-g++}" -std=c++17 -O1 -Wall -Wextra -I"$kernels"
"${CXX:-g++}" "$build"/*.o -o "$build/emulate"
"$build/emulate" "$pictures"
