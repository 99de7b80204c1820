// Runs a libFuzzer target without libFuzzer: on as many inputs of random bytes as the argument says.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include "fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size);

int main(int, char **argv) {
    if (recorder::sets_of_this_processor().back() != recorder::InstructionSet::avx512) {
        std::fputs("AVX-512 is emulated with AVX2, which this processor lacks\n", stderr);
        return 1;
    }
    std::mt19937 random(1);
    const int inputs = std::atoi(argv[1]);
    for (int i = 0; i < inputs; ++i) {
        std::vector<std::uint8_t> input(16 + random() % 4096);
        for (std::uint8_t &byte : input) byte = static_cast<std::uint8_t>(random());
        LLVMFuzzerTestOneInput(input.data(), input.size());
    }
    std::printf("%d pictures, nothing found\n", inputs);
}
