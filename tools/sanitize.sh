#!/bin/sh
# Round trips and broken images under the address and undefined-behaviour sanitizers: the kernels for
# this processor and the portable ones. Usage: tools/sanitize.sh [PICTURES]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
kernels=$root/recorder/kernels
build=$(mktemp -d)
trap 'rm -rf "$build"' EXIT
sources=$(find "$kernels" -name '*.cpp' ! -name bindings.cpp)
# shellcheck disable=SC2086  # one path a word
"${CXX:-g++}" -std=c++17 -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -Wall -Wextra \
    -I"$kernels" "$root/tools/sanitize.cpp" $sources -o "$build/sanitize"
"$build/sanitize" "${1:-1000}"
RECORDER_PORTABLE_KERNELS=1 "$build/sanitize" "${1:-1000}"
