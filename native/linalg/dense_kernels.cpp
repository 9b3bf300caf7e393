// Cholesky of a front's pivot block, triangular solves with it, and the table of all dense kernels.
#include "linalg/dense.hpp"
#include "linalg/front_kernels.hpp"
#include "linalg/multiply.hpp"
#include "linalg/vector.hpp"

namespace clew::CLEW_ISA {

namespace {

using linalg::Multiply;
using linalg::Product;

constexpr int kBlock = 8;  // columns that are solved within registers
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

// N rows of X against a small triangle, in registers: X L^-T, or X L^-1 when not Transposed.
template <int N, int C, bool Transposed>
inline void solve_rows(const double* d, int64_t ldd, double* x, int64_t ldx) {
    Vector<N> column[C];
#pragma GCC unroll 8
    for (int p = 0; p < C; ++p) column[p] = load<N>(x + p * ldx);
    if constexpr (Transposed) {
#pragma GCC unroll 8
        for (int p = 0; p < C; ++p) {
#pragma GCC unroll 8
            for (int q = 0; q < p; ++q) column[p] -= column[q] * d[p + q * ldd];
            column[p] *= d[p + p * ldd];
        }
    } else {
#pragma GCC unroll 8
        for (int p = C - 1; p >= 0; --p) {
#pragma GCC unroll 8
            for (int q = p + 1; q < C; ++q) column[p] -= column[q] * d[q + p * ldd];
            column[p] *= d[p + p * ldd];
        }
    }
#pragma GCC unroll 8
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

// Recursion halves the triangle (in whole blocks), so that nearly all work is in large products.
int first_half(int n) { return (n / 2 + kBlock - 1) / kBlock * kBlock; }

void solve_transposed(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx,
                      double* scratch) {
    if (n <= kBlock) return solve_of<true>(n, rows, d, ldd, x, ldx);
    const int n1 = first_half(n), n2 = n - n1;
    solve_transposed(rows, n1, d, ldd, x, ldx, scratch);
    multiply({rows, n2, n1, x, ldx, d + n1, 1, ldd, x + n1 * ldx, ldx, Product::kSubtract, false}, scratch);
    solve_transposed(rows, n2, d + n1 + n1 * ldd, ldd, x + n1 * ldx, ldx, scratch);
}

void solve_straight(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx, double* scratch) {
    if (n <= kBlock) return solve_of<false>(n, rows, d, ldd, x, ldx);
    const int n1 = first_half(n), n2 = n - n1;
    solve_straight(rows, n2, d + n1 + n1 * ldd, ldd, x + n1 * ldx, ldx, scratch);
    multiply({rows, n1, n2, x + n1 * ldx, ldx, d + n1, ldd, 1, x, ldx, Product::kSubtract, false}, scratch);
    solve_straight(rows, n1, d, ldd, x, ldx, scratch);
}

int32_t cholesky(int32_t n, double* d, int64_t ldd, double* scratch) {
    if (n <= kBlock) return cholesky_of(n, d, ldd);
    const int n1 = first_half(n), n2 = n - n1;
    int failed = cholesky(n1, d, ldd, scratch);
    if (failed >= 0) return failed;
    double* below = d + n1;
    double* rest = d + n1 + n1 * ldd;
    solve_transposed(n2, n1, d, ldd, below, ldd, scratch);
    multiply({n2, n2, n1, below, ldd, below, 1, ldd, rest, ldd, Product::kSubtract, true}, scratch);
    failed = cholesky(n2, rest, ldd, scratch);
    return failed < 0 ? failed : n1 + failed;
}

}  // namespace

const linalg::DenseKernels& dense_kernels() {
    static constexpr linalg::DenseKernels table = {
        multiply, cholesky, solve_transposed, solve_straight, forward, backward, add_to_panel, add_to_update};
    return table;
}

}  // namespace clew::CLEW_ISA
