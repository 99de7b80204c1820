#!/bin/sh
# Round trips and broken images under the address and undefined-behaviour sanitizers: the best kernels for
# this processor and the scalar ones. Usage: tools/sanitize.sh [PICTURES]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
kernels=$root/recorder/kernels
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
flags="-std=c++17 -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -Wall -Wextra -I$kernels"
for source in "$root/tools/sanitize.cpp" $(find "$kernels" -name '*.cpp' ! -name bindings.cpp); do
    case $source in
        *_vector.cpp) wide="-mavx2 -mbmi -mbmi2 -mlzcnt -mmovbe" ;;
        *) wide="" ;;
    esac
    # shellcheck disable=SC2086  # one flag a word
    "${CXX:-g++}" $flags $wide -c "$source" -o "$build/$(basename "$source").o"
done
"${CXX:-g++}" -fsanitize=address,undefined "$build"/*.o -o "$build/sanitize"
"$build/sanitize" "${1:-1000}"
RECORDER_KERNELS=scalar "$build/sanitize" "${1:-1000}"
