// The vector operations that the kernels need, of the instruction set that this file is compiled for. The
// sources named *_vector.cpp and their headers name no instruction: they are compiled once for each set (the
// decoders for AVX2 alone), into the namespace recorder::RECORDER_VECTOR.
#pragma once

#if defined(RECORDER_AVX512)
#include "logarithm_avx512.hpp"
#define RECORDER_VECTOR avx512
#else
#include "logarithm_avx2.hpp"
#define RECORDER_VECTOR avx2
#endif
