#!/bin/sh
# Fuzzes the codec's kernels under the address and undefined-behaviour sanitizers: any bytes decoded and, at the same
# time, any pictures encoded, with every set of instructions that the kernels know and this processor has: all must
# agree. Inputs that reached something new, and those that broke something, are kept in build/fuzz.
# usage: fuzz.sh SECONDS [SEED]
set -eu
seconds=$1
seed=${2:-0} # 0: another one each time
root=$(cd "$(dirname "$0")/.." && pwd)
kernels=$root/recorder/kernels
CXX=${CXX:-clang++}
mkdir -p "$root/build/fuzz"
cd "$root/build/fuzz"

rm -f ./*.o # then linking fails where compiling did
compile() { # compile OBJECT SOURCE FLAGS...
    object=$1
    shift
    "$CXX" -std=c++17 -O2 -g -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all -Wall -Wextra \
        -I"$kernels" -c "$@" -o "$object.o" &
}
avx2="-mavx2 -mbmi -mbmi2 -mlzcnt -mmovbe"
avx512="-mavx512f -mavx512bw -mavx512cd -mavx512dq -mavx512vl"
# shellcheck disable=SC2086  # one option a word
for source in "$root"/tools/fuzz_*.cpp "$kernels"/*.cpp; do
    name=$(basename "$source" .cpp)
    case $name in
        bindings | cpu | vector_kernels) ;; # fuzz_sets stands for the last two
        decode*_vector) compile "$name-avx2" "$source" $avx2 ;;
        *_vector)
            compile "$name-avx2" "$source" $avx2
            compile "$name-avx512" "$source" $avx2 $avx512 -DRECORDER_AVX512
            ;;
        *) compile "$name" "$source" ;;
    esac
done
wait

for target in decode encode; do
    other=$([ $target = decode ] && echo encode || echo decode)
    # shellcheck disable=SC2046  # one object a word
    "$CXX" -fsanitize=fuzzer,address,undefined $(find . -name '*.o' ! -name "fuzz_$other.o") -o "$target"
done

run() { # run TARGET: an image of 20000 bytes has at most 160000 pixels; who takes more memory believed a header
    mkdir -p "$1-corpus"
    "./$1" "$1-corpus" -max_total_time="$seconds" -seed="$seed" -max_len=20000 -timeout=10 -malloc_limit_mb=8 \
        -rss_limit_mb=1024 -print_final_stats=1 -artifact_prefix="$1-" >"$1.log" 2>&1 || {
        grep -v '^#' "$1.log" >&2
        echo "fuzzing $1 failed: $root/build/fuzz/$1 FILE runs the input named above again" >&2
        return 1
    }
    echo "$1: $(sed -n 's/stat::number_of_executed_units: *//p' "$1.log") inputs, nothing found"
}
run decode &
decode=$!
failed=0
run encode || failed=1
wait $decode || failed=1
exit $failed
