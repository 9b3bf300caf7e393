// Dense kernels on column-major arrays, one copy an instruction set (see isa.hpp).
//
// Rows of operands that are vectors of columns ("tall") are stored in leading dimensions that are multiples of 4, and
// kernels read and write whole groups of 4 rows: rows of padding hold zeros or numbers without meaning.
#pragma once

#include <cstdint>

#include "isa.hpp"
#include "linalg/run.hpp"

namespace clew::linalg {

// Products over no more than this sum in one go, so that they come out the same to the last bit in whatever pieces.
constexpr int32_t kDepthBlock = 192;

// How the product meets what is in C.
enum class Product { kSetNegative, kSubtract };

// C (rows x cols) = -A B or C -= A B, over `depth`. A is tall, rows x depth; element (p, j) of B is
// b[j * b_col + p * b_row]. With `lower`, only entries on and below the diagonal have a meaning afterwards.
struct Multiply {
    int32_t rows, cols, depth;
    const double* a;
    int64_t lda;
    const double* b;
    int64_t b_col, b_row;
    double* c;
    int64_t ldc;
    Product product;
    bool lower;
};

// Columns [begin, end).
struct Columns {
    int32_t begin, end;
};

struct DenseKernels {
    // `scratch` holds `multiply_scratch` doubles.
    void (*multiply)(const Multiply& m, double* scratch);

    // Cholesky of the lower triangle of D, reciprocals of the pivots on its diagonal. Returns the column whose pivot is
    // not positive and finite, or -1.
    int32_t (*cholesky)(int32_t n, double* d, int64_t ldd, double* scratch);

    // X <- X L^-T and X <- X L^-1 for X tall (rows x n), L as `cholesky` leaves it.
    void (*solve_transposed)(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx,
                             double* scratch);
    void (*solve_straight)(int32_t rows, int32_t n, const double* d, int64_t ldd, double* x, int64_t ldx,
                           double* scratch);

    // One right-hand side. forward: x <- L11^-1 x, t = L21 x; backward: x <- L11^-T (x - L21^T t). `d` holds the
    // columns of the triangle without gaps, `t` ldb numbers.
    void (*forward)(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x, double* t);
    void (*backward)(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x,
                     const double* t);

    // Extend-add of a child's update matrix u (see update_matrix.hpp): what falls into some columns of the parent's
    // panel, or of its update matrix.
    void (*add_to_panel)(const double* u, int64_t ldu, const Run* runs, const Run* remaining, const Run* end,
                         Columns columns, double* d, int64_t ldd, double* b, int64_t ldb);
    void (*add_to_update)(const double* u, int64_t ldu, const Run* remaining, const Run* end, Columns columns,
                          double* to, int64_t ldt);
};

}  // namespace clew::linalg

CLEW_DECLARE(const ::clew::linalg::DenseKernels& dense_kernels(); int64_t multiply_scratch();)
