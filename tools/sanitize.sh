#!/bin/sh
# Round trips and broken images under the address and undefined-behaviour sanitizers, by the kernels of every
# instruction set: all must write and read the same. Where the processor lacks AVX-512, SIMDe (Debian's
# libsimde-dev) stands for it. Usage: tools/sanitize.sh [PICTURES]; quicker with an empty SANITIZERS=
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
kernels=$root/recorder/kernels
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
avx2="-mavx2 -mbmi -mbmi2 -mlzcnt -mmovbe"
if grep -q avx512bw /proc/cpuinfo; then
    avx512="$avx2 -mavx512f -mavx512bw -mavx512cd -mavx512dq -mavx512vl"
    emulated=""
else
    # without the checks that SIMDe would multiply: the same sources have them as AVX2
    avx512="$avx2 -isystem $root/tools/emulated_avx512 -Wno-psabi -fno-sanitize=undefined"
    emulated="-DRECORDER_EMULATED_AVX512"
fi

sanitizers=${SANITIZERS-address,undefined}
flags="-std=c++17 -O1 -Wall -Wextra -I$kernels"
[ -z "$sanitizers" ] || flags="$flags -g -fsanitize=$sanitizers -fno-sanitize-recover=all"
for source in "$root/tools/sanitize.cpp" $(find "$kernels" -name '*.cpp' ! -name bindings.cpp); do
    object=$build/$(basename "$source" .cpp)
    case $source in
        *_vector.cpp)
            echo "$avx512 -DRECORDER_AVX512 -c $source -o $object.avx512.o"
            echo "$avx2 -DRECORDER_AVX2 -c $source -o $object.avx2.o"
            ;;
        *) echo "$emulated -c $source -o $object.o" ;;
    esac
done | xargs -P "$(nproc)" -L 1 "${CXX:-g++}" $flags
# shellcheck disable=SC2086
"${CXX:-g++}" $flags "$build"/*.o -o "$build/sanitize"

for set in scalar avx2 avx512; do
    RECORDER_KERNELS=$set "$build/sanitize" "${1:-1000}" >"$build/$set"
    echo "$set: $(cat "$build/$set")"
    cmp "$build/scalar" "$build/$set"
done
