// Chosen blocks of the inverse without the inverse.
//
// Takahashi, Fagan, Chen, "Formation of a sparse bus impedance matrix and its application to short circuit study"
// (PICA 1973), on dense fronts. With L11, L21 of a front, G = L21 L11^-1 and Z_RR the inverse at its update rows:
//   Z_RP = -Z_RR G,   Z_PP = (L11 L11^T)^-1 + G^T Z_RR G = (L11 L11^T)^-1 - G^T Z_RP.
// From root to leaves each front hands Z_RR to its children, in the places and the form of their update matrices.
#include <algorithm>
#include <cstring>

#include "linalg/numeric.hpp"
#include "linalg/update_matrix.hpp"

namespace clew::linalg {

namespace {

int64_t padded(int32_t n) { return (n + 3) / 4 * 4; }

void negate(double* x, int64_t n) {
    for (int64_t i = 0; i < n; ++i) x[i] = -x[i];
}

// Both triangles, leading dimension `ld`, of the lower triangle that an update matrix holds; the upper one in tiles
// that stay in cache.
void unpack(const double* packed, int32_t n, int64_t ld, double* z) {
    constexpr int32_t kTile = 16;
    for (int32_t j = 0; j < n; ++j) {
        const double* column = packed + column_start(j, ld);
        std::copy(column + j, column + n, z + j + j * ld);
        std::fill(z + n + j * ld, z + (n + 3) / 4 * 4 + j * ld, 0.0);
    }
    for (int32_t jj = 0; jj < n; jj += kTile) {
        for (int32_t ii = jj; ii < n; ii += kTile) {
            for (int32_t j = jj; j < std::min(n, jj + kTile); ++j) {
                for (int32_t i = std::max(ii, j + 1); i < std::min(n, ii + kTile); ++i) z[j + i * ld] = z[i + j * ld];
            }
        }
    }
}

}  // namespace

// The inverse at the rows of one front, and what is needed to form it.
class Numeric::InverseFront {
public:
    explicit InverseFront(const Symbolic& symbolic) : scratch_(symbolic) {
        int64_t size = 0;
        for (const Front& f : symbolic.fronts) {
            const int64_t k = padded(f.pivots);
            size = std::max(size, k * (2 * f.pivots + int64_t{f.updates}) +
                                      int64_t{f.ld_b} * (f.pivots + int64_t{f.updates}));
        }
        storage_ = Buffer(size);
    }

    // `packed`: the inverse at the update rows, in the form of an update matrix.
    void invert(const Numeric& factor, const Front& f, const double* packed) {
        const DenseKernels& kernels = factor.kernels_;
        double* scratch = scratch_.multiply.data();
        const int32_t k = f.pivots, m = f.updates;
        ld_d = padded(k);
        double* w = storage_.data();                       // L11^-T
        z_pp = w + ld_d * k;
        double* minus_gt = z_pp + ld_d * k;                // -G^T
        z_rp = minus_gt + ld_d * m;
        z_rr = z_rp + int64_t{f.ld_b} * k;
        unpack(packed, m, f.ld_b, z_rr);
        std::memset(w, 0, static_cast<size_t>(ld_d * k) * sizeof(double));
        for (int32_t p = 0; p < k; ++p) w[p + p * ld_d] = 1.0;
        kernels.solve_transposed(k, k, factor.square(f, scratch_), f.ld_d, w, ld_d, scratch);
        kernels.multiply({k, k, k, w, ld_d, w, 1, ld_d, z_pp, ld_d, Product::kSetNegative, false}, scratch);
        if (m > 0) {
            kernels.multiply({k, m, k, w, ld_d, factor.b(f), 1, f.ld_b, minus_gt, ld_d, Product::kSetNegative, false},
                             scratch);
            kernels.multiply({m, k, m, z_rr, f.ld_b, minus_gt, 1, ld_d, z_rp, f.ld_b, Product::kSetNegative, false},
                             scratch);
            negate(z_rp, int64_t{f.ld_b} * k);
            kernels.multiply({k, k, m, minus_gt, ld_d, z_rp, f.ld_b, 1, z_pp, ld_d, Product::kSubtract, false},
                             scratch);
        }
        negate(z_pp, ld_d * k);
    }

    // The inverse at the update rows of a child: its lower triangle.
    void hand_down(const Symbolic& symbolic, const Front& f, int32_t c, double* to) const {
        const Front& child = symbolic.fronts[c];
        const Run* runs = symbolic.runs.data();
        const Run *remaining = runs + child.remaining_runs, *end = runs + symbolic.fronts[c + 1].runs;
        for (const Run* across = runs + child.runs; across != end; ++across) {
            for (int32_t j = 0; j < across->length; ++j) {
                double* column = to + column_start(across->from + j, child.ld_b);
                const Run* down = across;
                const double* below = z_rr;
                int32_t above = j;  // rows of the first run that are above the diagonal
                if (across < remaining) {
                    for (; down != remaining; ++down) {
                        const double* from = z_pp + down->to + (across->to + j) * ld_d;
                        std::copy(from + above, from + down->length, column + down->from + above);
                        above = 0;
                    }
                    below = z_rp;
                }
                for (; down != end; ++down) {
                    const double* from = below + down->to + (across->to + j) * int64_t{f.ld_b};
                    std::copy(from + above, from + down->length, column + down->from + above);
                    above = 0;
                }
            }
        }
    }

    void write(const Symbolic& symbolic, const Front& f, int64_t rows_end, const InverseBlock& block,
               double* out) const {
        const int64_t column = symbolic.starts[block.col] - f.column;
        const double* z = z_pp + (symbolic.starts[block.row] - f.column) + column * ld_d;
        int64_t ld = ld_d;
        if (block.row >= f.last) {
            const auto begin = symbolic.rows.begin();
            const auto row = std::lower_bound(begin + f.rows, begin + rows_end, block.row) - begin;
            z = z_rp + symbolic.row_offsets[row] + column * f.ld_b;
            ld = f.ld_b;
        }
        const int32_t rows = symbolic.size_at(block.row), cols = symbolic.size_at(block.col);
        const int32_t across = block.transposed ? 1 : cols, down = block.transposed ? rows : 1;
        for (int32_t j = 0; j < cols; ++j) {
            for (int32_t i = 0; i < rows; ++i) out[block.target + i * across + j * down] = z[i + j * ld];
        }
    }

private:
    Scratch scratch_;
    Buffer storage_;
    int64_t ld_d = 0;
    double* z_pp = nullptr;
    double* z_rp = nullptr;
    double* z_rr = nullptr;
};

bool Numeric::stores(int32_t row, int32_t col) const {
    const int32_t s = symbolic_.front_of[col];
    const Front& f = symbolic_.fronts[s];
    const auto begin = symbolic_.rows.begin();
    return row < f.last || std::binary_search(begin + f.rows, begin + symbolic_.fronts[s + 1].rows, row);
}

void Numeric::inverse_blocks(const std::vector<InverseBlock>& wanted, double* out) {
    const Symbolic& sym = symbolic_;
    std::vector<bool> needed(sym.count(), false);
    for (const InverseBlock& block : wanted) {
        for (int32_t s = sym.front_of[block.col]; s != -1 && !needed[s]; s = sym.fronts[s].parent) needed[s] = true;
    }
    // Panels are full and kept updates must survive, so the inverse has places of its own.
    const Schedule schedule = make_schedule(sym, threads_, Updates::kApart);
    Buffer storage(schedule.storage_size);

    const auto visit = [&](int32_t s, InverseFront& inverse) {
        if (!needed[s]) return;
        const Front &f = sym.fronts[s], &next = sym.fronts[s + 1];
        inverse.invert(*this, f, storage.data() + schedule.update[s]);
        for (int64_t q = f.children; q < next.children; ++q) {
            const int32_t c = sym.children[q];
            if (needed[c]) inverse.hand_down(sym, f, c, storage.data() + schedule.update[c]);
        }
        auto block = std::lower_bound(wanted.begin(), wanted.end(), f.first,
                                      [](const InverseBlock& w, int32_t first) { return w.col < first; });
        for (; block != wanted.end() && block->col < f.last; ++block) inverse.write(sym, f, next.rows, *block, out);
    };
    const auto states = make_states<InverseFront>(schedule);
    for (auto s = schedule.top.rbegin(); s != schedule.top.rend(); ++s) visit(*s, *states[0]);
    Team team(states.size());
    team.run(schedule.tasks.size(), [&](size_t t, size_t worker) {
        for (int32_t s = schedule.tasks[t].end - 1; s >= schedule.tasks[t].begin; --s) visit(s, *states[worker]);
    });
}

}  // namespace clew::linalg
