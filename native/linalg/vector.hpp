// Vectors of doubles for the *_kernels.cpp files, in the width of the instruction set being compiled.
#pragma once

#include <cstdint>

namespace clew::CLEW_ISA {

#if defined(__AVX512F__)
constexpr int kWidth = 8;    // doubles in a vector
constexpr int kTileRows = 3; // vectors in a register tile
constexpr int kTileCols = 8;
#elif defined(__AVX2__)
constexpr int kWidth = 4;
constexpr int kTileRows = 3;
constexpr int kTileCols = 4;
#else
constexpr int kWidth = 2;
constexpr int kTileRows = 2;
constexpr int kTileCols = 4;
#endif

template <int N>
struct VectorOf;
template <>
struct VectorOf<2> {
    typedef double type __attribute__((vector_size(16)));
};
template <>
struct VectorOf<4> {
    typedef double type __attribute__((vector_size(32)));
};
template <>
struct VectorOf<8> {
    typedef double type __attribute__((vector_size(64)));
};

template <int N>
using Vector = typename VectorOf<N>::type;

template <int N>
inline Vector<N> load(const double* p) {
    Vector<N> v;
    __builtin_memcpy(&v, p, sizeof v);
    return v;
}

template <int N>
inline void store(double* p, Vector<N> v) {
    __builtin_memcpy(p, &v, sizeof v);
}

// Leading dimensions are multiples of 4: the narrowest vector that a group of 4 rows is made of.
constexpr int kNarrow = kWidth < 4 ? kWidth : 4;

}  // namespace clew::CLEW_ISA
