// One right-hand side through a front, and the extend-add of a child's update matrix into its parent.
#include "linalg/front_kernels.hpp"
#include "linalg/run.hpp"
#include "linalg/update_matrix.hpp"
#include "linalg/vector.hpp"

namespace clew::CLEW_ISA {

namespace {

using linalg::Columns;
using linalg::Run;

// t += (or =) C columns of B times x.
template <int C>
void add_columns(int rows, const double* b, int64_t ldb, const double* x, double* t, bool set) {
    double scale[C];
    for (int p = 0; p < C; ++p) scale[p] = x[p];
    for (int i = 0; i < rows; i += kNarrow) {
        Vector<kNarrow> sum = {};
        if (!set) sum = load<kNarrow>(t + i);
        for (int p = 0; p < C; ++p) sum += load<kNarrow>(b + i + p * ldb) * scale[p];
        store<kNarrow>(t + i, sum);
    }
}

// x -= (C columns of B)^T t.
template <int C>
void subtract_dots(int rows, const double* b, int64_t ldb, double* x, const double* t) {
    Vector<kNarrow> sum[C];
    for (int p = 0; p < C; ++p) sum[p] = Vector<kNarrow>{};
    for (int i = 0; i < rows; i += kNarrow) {
        const Vector<kNarrow> rhs = load<kNarrow>(t + i);
        for (int p = 0; p < C; ++p) sum[p] += load<kNarrow>(b + i + p * ldb) * rhs;
    }
    for (int p = 0; p < C; ++p) {
        for (int k = 0; k < kNarrow; ++k) x[p] -= sum[p][k];
    }
}

inline void add(double* to, const double* from, int length) {
    int i = 0;
    for (; i + kNarrow <= length; i += kNarrow) store<kNarrow>(to + i, load<kNarrow>(to + i) + load<kNarrow>(from + i));
    for (; i < length; ++i) to[i] += from[i];
}

// Scalars of a run that lie before a column of the parent.
inline int within(const Run& run, int32_t column) {
    const int32_t before = column - run.to;
    return before < 0 ? 0 : before < run.length ? before : run.length;
}

}  // namespace

void forward(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x, double* t) {
    for (int p = 0; p < n; d += n - p, ++p) {
        x[p] *= d[0];
        for (int q = p + 1; q < n; ++q) x[q] -= d[q - p] * x[p];
    }
    int p = 0;
    for (; p + 4 <= n; p += 4) add_columns<4>(rows, b + p * ldb, ldb, x + p, t, p == 0);
    switch (n - p) {
        case 3: return add_columns<3>(rows, b + p * ldb, ldb, x + p, t, p == 0);
        case 2: return add_columns<2>(rows, b + p * ldb, ldb, x + p, t, p == 0);
        case 1: return add_columns<1>(rows, b + p * ldb, ldb, x + p, t, p == 0);
        default: return;
    }
}

void backward(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x, const double* t) {
    int p = 0;
    for (; p + 4 <= n; p += 4) subtract_dots<4>(rows, b + p * ldb, ldb, x + p, t);
    if (n - p == 3) subtract_dots<3>(rows, b + p * ldb, ldb, x + p, t);
    else if (n - p == 2) subtract_dots<2>(rows, b + p * ldb, ldb, x + p, t);
    else if (n - p == 1) subtract_dots<1>(rows, b + p * ldb, ldb, x + p, t);
    const double* column = d + int64_t{n} * (n + 1) / 2;
    for (p = n - 1; p >= 0; --p) {
        column -= n - p;
        double sum = x[p];
        for (int q = p + 1; q < n; ++q) sum -= column[q - p] * x[q];
        x[p] = sum * column[0];
    }
}

void add_to_panel(const double* u, int64_t ldu, const Run* runs, const Run* remaining, const Run* end, Columns columns,
                  double* d, int64_t ldd, double* b, int64_t ldb) {
    for (const Run* across = runs; across != remaining && across->to < columns.end; ++across) {
        const int last = within(*across, columns.end);
        for (int j = within(*across, columns.begin); j < last; ++j) {
            const double* from = u + linalg::column_start(across->from + j, ldu);
            double* to_d = d + (across->to + j) * ldd;
            double* to_b = b + (across->to + j) * ldb;
            add(to_d + across->to + j, from + across->from + j, across->length - j);
            for (const Run* down = across + 1; down != remaining; ++down) {
                add(to_d + down->to, from + down->from, down->length);
            }
            for (const Run* down = remaining; down != end; ++down) {
                add(to_b + down->to, from + down->from, down->length);
            }
        }
    }
}

void add_to_update(const double* u, int64_t ldu, const Run* remaining, const Run* end, Columns columns, double* to,
                   int64_t ldt) {
    for (const Run* across = remaining; across != end && across->to < columns.end; ++across) {
        const int last = within(*across, columns.end);
        for (int j = within(*across, columns.begin); j < last; ++j) {
            const double* from = u + linalg::column_start(across->from + j, ldu);
            double* column = to + linalg::column_start(across->to + j, ldt);
            add(column + across->to + j, from + across->from + j, across->length - j);
            for (const Run* down = across + 1; down != end; ++down) {
                add(column + down->to, from + down->from, down->length);
            }
        }
    }
}

}  // namespace clew::CLEW_ISA
