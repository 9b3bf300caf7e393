// Matrix product for all dense work of the factorisation: register tiles, with packing once operands outgrow the cache.
#include "linalg/dense.hpp"
#include "linalg/multiply.hpp"
#include "linalg/vector.hpp"

namespace clew::CLEW_ISA {

namespace {

using linalg::kDepthBlock;
using linalg::Multiply;
using linalg::Product;

// Packing copies operands into the order in which tiles read them; blocks are sized for L1 (a panel of B) and L2
// (a block of A).
constexpr int kPackedRows = kTileRows * kWidth;
constexpr int kRowBlock = 240 / kPackedRows * kPackedRows;
constexpr int kColBlock = 96;
constexpr int64_t kPackedFrom = 24 * 1024;  // doubles of A above which packing pays

struct Operands {
    const double* a;
    int64_t lda;
    const double* b;
    int64_t b_col, b_row;
    double* c;
    int64_t ldc;
    int depth;
    bool set;  // C = -A B instead of C -= A B
};

// One tile of V vectors of N rows by C columns, accumulated in registers: every loop over V or C is unrolled, and
// accumulators are set one by one, for an initialiser of the array would clear memory, too.
template <int N, int V, int C>
inline void tile(const Operands& o) {
    Vector<N> sum[V][C];
#pragma GCC unroll 8
    for (int j = 0; j < C; ++j) {
#pragma GCC unroll 3
        for (int v = 0; v < V; ++v) sum[v][j] = Vector<N>{};
    }
    const double* a = o.a;
    const double* b = o.b;
    for (int p = 0; p < o.depth; ++p, a += o.lda, b += o.b_row) {
        Vector<N> column[V];
#pragma GCC unroll 3
        for (int v = 0; v < V; ++v) column[v] = load<N>(a + v * N);
#pragma GCC unroll 8
        for (int j = 0; j < C; ++j) {
            const double scale = b[j * o.b_col];
#pragma GCC unroll 3
            for (int v = 0; v < V; ++v) sum[v][j] += column[v] * scale;
        }
    }
#pragma GCC unroll 8
    for (int j = 0; j < C; ++j) {
        double* c = o.c + j * o.ldc;
#pragma GCC unroll 3
        for (int v = 0; v < V; ++v) {
            const Vector<N> before = o.set ? Vector<N>{} : load<N>(c + v * N);
            store<N>(c + v * N, before - sum[v][j]);
        }
    }
}

// All rows [row, rows) of C columns; rows come in groups of 4.
template <int C>
void strip(Operands o, int rows) {
    const auto advance = [&](int by) {
        o.a += by;
        o.c += by;
        rows -= by;
    };
    while (rows >= kTileRows * kWidth) {
        tile<kWidth, kTileRows, C>(o);
        advance(kTileRows * kWidth);
    }
    if constexpr (kTileRows == 3) {
        if (rows >= 2 * kWidth) {
            tile<kWidth, 2, C>(o);
            advance(2 * kWidth);
        }
    }
    if (rows >= kWidth) {
        tile<kWidth, 1, C>(o);
        advance(kWidth);
    }
    if constexpr (kWidth > kNarrow) {
        if (rows > 0) tile<kNarrow, 1, C>(o);
    } else if constexpr (kWidth == 2) {
        if (rows > 0) tile<kWidth, 1, C>(o);
    }
}

void strip_of(int cols, const Operands& o, int rows) {
    switch (cols) {
        case 1: return strip<1>(o, rows);
        case 2: return strip<2>(o, rows);
        case 3: return strip<3>(o, rows);
        case 4: return strip<4>(o, rows);
#if defined(__AVX512F__)
        case 5: return strip<5>(o, rows);
        case 6: return strip<6>(o, rows);
        case 7: return strip<7>(o, rows);
        case 8: return strip<8>(o, rows);
#endif
        default: return;
    }
}

// Straight from the operands: each column strip of C against all rows.
void multiply_in_place(const Multiply& m) {
    const int rows = (m.rows + 3) / 4 * 4;
    for (int j = 0; j < m.cols; j += kTileCols) {
        const int cols = m.cols - j < kTileCols ? m.cols - j : kTileCols;
        const int top = m.lower ? j / 4 * 4 : 0;
        strip_of(cols, {m.a + top, m.lda, m.b + j * m.b_col, m.b_col, m.b_row, m.c + top + j * m.ldc, m.ldc, m.depth,
                        m.product == Product::kSetNegative}, rows - top);
    }
}

// Panels of kTileCols columns of B, depth-major.
void pack_b(const Multiply& m, int from, int depth, double* to) {
    for (int j = 0; j < m.cols; j += kTileCols) {
        const int cols = m.cols - j < kTileCols ? m.cols - j : kTileCols;
        const double* b = m.b + j * m.b_col + from * m.b_row;
        for (int p = 0; p < depth; ++p, b += m.b_row) {
            for (int q = 0; q < cols; ++q) to[p * kTileCols + q] = b[q * m.b_col];
            for (int q = cols; q < kTileCols; ++q) to[p * kTileCols + q] = 0;
        }
        to += depth * kTileCols;
    }
}

// Panels of kPackedRows rows of A, depth-major; the last panel is as narrow as the rows that are left.
void pack_a(const double* a, int64_t lda, int rows, int depth, double* to) {
    for (int i = 0; i < rows; i += kPackedRows) {
        const int height = rows - i < kPackedRows ? rows - i : kPackedRows;
        for (int p = 0; p < depth; ++p, to += height) {
            const double* column = a + i + p * lda;
            for (int r = 0; r < height; r += kNarrow) store<kNarrow>(to + r, load<kNarrow>(column + r));
        }
    }
}

void multiply_packed(const Multiply& m, double* scratch) {
    const int rows = (m.rows + 3) / 4 * 4;
    double* packed_a = scratch;
    double* packed_b = scratch + kRowBlock * kDepthBlock;
    for (int from = 0; from < m.depth; from += kDepthBlock) {
        const int depth = m.depth - from < kDepthBlock ? m.depth - from : kDepthBlock;
        const bool set = m.product == Product::kSetNegative && from == 0;
        pack_b(m, from, depth, packed_b);
        for (int block = 0; block < rows; block += kRowBlock) {
            const int height = rows - block < kRowBlock ? rows - block : kRowBlock;
            pack_a(m.a + block + from * m.lda, m.lda, height, depth, packed_a);
            const int cols_end = m.lower && block + height < m.cols ? block + height : m.cols;
            for (int j = 0; j < cols_end; j += kTileCols) {
                const int cols = m.cols - j < kTileCols ? m.cols - j : kTileCols;
                const int skip = m.lower && j > block ? (j - block) / kPackedRows * kPackedRows : 0;
                for (int i = skip; i < height; i += kPackedRows) {
                    const int tall = height - i < kPackedRows ? height - i : kPackedRows;
                    strip_of(cols, {packed_a + i * depth, tall, packed_b + j * depth, 1, kTileCols,
                                    m.c + block + i + j * m.ldc, m.ldc, depth, set}, tall);
                }
            }
        }
    }
}

}  // namespace

int64_t multiply_scratch() { return int64_t{kDepthBlock} * (kRowBlock + kColBlock); }

void multiply(const Multiply& m, double* scratch) {
    if (m.rows <= 0 || m.cols <= 0) return;
    if (m.depth < 16 || m.cols < 2 * kTileCols || int64_t{m.rows} * m.depth < kPackedFrom) {
        multiply_in_place(m);
        return;
    }
    for (int j = 0; j < m.cols; j += kColBlock) {
        Multiply part = m;
        const int top = m.lower ? j : 0;
        part.rows -= top;
        part.cols = m.cols - j < kColBlock ? m.cols - j : kColBlock;
        part.a += top;
        part.b += j * m.b_col;
        part.c += top + j * m.ldc;
        multiply_packed(part, scratch);
    }
}

}  // namespace clew::CLEW_ISA
