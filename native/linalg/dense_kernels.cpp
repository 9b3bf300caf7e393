// Cholesky of a front's pivot block, triangular solves with it, and the table of all dense kernels.
#include "linalg/dense.hpp"
#include "linalg/front_kernels.hpp"
#include "linalg/multiply.hpp"
#include "linalg/vector.hpp"

namespace clew::CLEW_ISA {

namespace {

using linalg::Multiply;
using linalg::Product;

constexpr int kBlock = 8;        // columns that are solved within registers
constexpr int kWideBlock = 64;   // columns that are updated by one product from all columns before them
constexpr double kLargest = 1.7976931348623157e308;

template <int N>
int cholesky_small(double* d, int64_t ldd) {
    for (int p = 0; p < N; ++p) {
        double pivot = d[p + p * ldd];
        for (int q = 0; q < p; ++q) pivot -= d[p + q * ldd] * d[p + q * ldd];
        if (!(pivot > 0 && pivot <= kLargest)) return p;
        const double reciprocal = 1.0 / __builtin_sqrt(pivot);
        d[p + p * ldd] = reciprocal;
        for (int i = p + 1; i < N; ++i) {
            double x = d[i + p * ldd];
            for (int q = 0; q < p; ++q) x -= d[i + q * ldd] * d[p + q * ldd];
            d[i + p * ldd] = x * reciprocal;
        }
    }
    return -1;
}

int cholesky_of(int n, double* d, int64_t ldd) {
    switch (n) {
        case 1: return cholesky_small<1>(d, ldd);
        case 2: return cholesky_small<2>(d, ldd);
        case 3: return cholesky_small<3>(d, ldd);
        case 4: return cholesky_small<4>(d, ldd);
        case 5: return cholesky_small<5>(d, ldd);
        case 6: return cholesky_small<6>(d, ldd);
        case 7: return cholesky_small<7>(d, ldd);
        default: return cholesky_small<8>(d, ldd);
    }
}

// N rows of X against a small triangle: X L^-T, or X L^-1 when not Transposed.
template <int N, int C, bool Transposed>
inline void solve_rows(const double* d, int64_t ldd, double* x, int64_t ldx) {
    Vector<N> column[C];
    for (int p = 0; p < C; ++p) column[p] = load<N>(x + p * ldx);
    if constexpr (Transposed) {
        for (int p = 0; p < C; ++p) {
            for (int q = 0; q < p; ++q) column[p] -= column[q] * d[p + q * ldd];
            column[p] *= d[p + p * ldd];
        }
    } else {
        for (int p = C - 1; p >= 0; --p) {
            for (int q = p + 1; q < C; ++q) column[p] -= column[q] * d[q + p * ldd];
            column[p] *= d[p + p * ldd];
        }
    }
    for (int p = 0; p < C; ++p) store<N>(x + p * ldx, column[p]);
}

template <int C, bool Transposed>
void solve_small(int rows, const double* d, int64_t ldd, double* x, int64_t ldx) {
    int i = 0;
    for (; i + kWidth <= rows; i += kWidth) solve_rows<kWidth, C, Transposed>(d, ldd, x + i, ldx);
    for (; i < rows; i += kNarrow) solve_rows<kNarrow, C, Transposed>(d, ldd, x + i, ldx);
}

template <bool Transposed>
void solve_of(int n, int rows, const double* d, int64_t ldd, double* x, int64_t ldx) {
    switch (n) {
        case 1: return solve_small<1, Transposed>(rows, d, ldd, x, ldx);
        case 2: return solve_small<2, Transposed>(rows, d, ldd, x, ldx);
        case 3: return solve_small<3, Transposed>(rows, d, ldd, x, ldx);
        case 4: return solve_small<4, Transposed>(rows, d, ldd, x, ldx);
        case 5: return solve_small<5, Transposed>(rows, d, ldd, x, ldx);
        case 6: return solve_small<6, Transposed>(rows, d, ldd, x, ldx);
        case 7: return solve_small<7, Transposed>(rows, d, ldd, x, ldx);
        default: return solve_small<8, Transposed>(rows, d, ldd, x, ldx);
    }
}

int lesser(int a, int b) { return a < b ? a : b; }

// Left-looking in two levels: wide blocks are brought up to date by one large product, small ones within them.
int32_t cholesky(int32_t n, double* d, int64_t ldd, double* scratch) {
    for (int wide = 0; wide < n; wide += kWideBlock) {
        const int end = lesser(n, wide + kWideBlock);
        if (wide > 0) {
            multiply({n - wide, end - wide, wide, d + wide, ldd, d + wide, 1, ldd, d + wide + wide * ldd, ldd,
                      Product::kSubtract, true}, scratch);
        }
        for (int j = wide; j < end; j += kBlock) {
            const int cols = lesser(kBlock, end - j);
            double* diagonal = d + j + j * ldd;
            if (j > wide) {
                const double* left = d + j + wide * ldd;
                multiply({n - j, cols, j - wide, left, ldd, left, 1, ldd, diagonal, ldd, Product::kSubtract, true},
                         scratch);
            }
            const int failed = cholesky_of(cols, diagonal, ldd);
            if (failed >= 0) return j + failed;
            if (j + cols < n) solve_of<true>(cols, n - j - cols, diagonal, ldd, diagonal + cols, ldd);
        }
    }
    return -1;
}

void solve_transposed(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx,
                      double* scratch) {
    for (int wide = 0; wide < n; wide += kWideBlock) {
        const int end = lesser(n, wide + kWideBlock);
        if (wide > 0) {
            multiply({rows, end - wide, wide, x, ldx, d + wide, 1, ldd, x + wide * ldx, ldx, Product::kSubtract, false},
                     scratch);
        }
        for (int j = wide; j < end; j += kBlock) {
            const int cols = lesser(kBlock, end - j);
            if (j > wide) {
                multiply({rows, cols, j - wide, x + wide * ldx, ldx, d + j + wide * ldd, 1, ldd, x + j * ldx, ldx,
                          Product::kSubtract, false}, scratch);
            }
            solve_of<true>(cols, rows, d + j + j * ldd, ldd, x + j * ldx, ldx);
        }
    }
}

void solve_straight(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx, double* scratch) {
    for (int j = (n - 1) / kBlock * kBlock; j >= 0; j -= kBlock) {
        const int cols = lesser(kBlock, n - j), after = j + cols;
        if (after < n) {
            multiply({rows, cols, n - after, x + after * ldx, ldx, d + after + j * ldd, ldd, 1, x + j * ldx, ldx,
                      Product::kSubtract, false}, scratch);
        }
        solve_of<false>(cols, rows, d + j + j * ldd, ldd, x + j * ldx, ldx);
    }
}

}  // namespace

const linalg::DenseKernels& dense_kernels() {
    static constexpr linalg::DenseKernels table = {
        multiply, cholesky, solve_transposed, solve_straight, forward, backward, add_to_panel, add_to_update};
    return table;
}

}  // namespace clew::CLEW_ISA
