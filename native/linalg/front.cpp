// Assembly and elimination of one front.
#include <algorithm>
#include <cstring>

#include "linalg/numeric.hpp"
#include "linalg/update_matrix.hpp"

namespace clew::linalg {

namespace {

inline void copy_sized(BlockCopy::Kind kind, const double* from, double* to, int64_t stride, int32_t rows,
                       int32_t cols) {
    switch (kind) {
        case BlockCopy::kStraight:
            for (int32_t j = 0; j < cols; ++j) {
                for (int32_t i = 0; i < rows; ++i) to[i + j * stride] = from[i * cols + j];
            }
            return;
        case BlockCopy::kTransposed:
            for (int32_t j = 0; j < cols; ++j) {
                for (int32_t i = 0; i < rows; ++i) to[i + j * stride] = from[j * rows + i];
            }
            return;
        case BlockCopy::kDiagonal:
            for (int32_t j = 0; j < cols; ++j) {
                for (int32_t i = j; i < rows; ++i) to[i + j * stride] = from[i * cols + j];
            }
            return;
    }
}

// Loops over the common sizes, those of poses, are unrolled.
void copy_block(const BlockCopy& copy, const double* values, const Front& front, double* d, double* b) {
    const double* from = values + copy.source;
    double* to = (copy.below ? b : d) + copy.target;
    const int64_t stride = copy.below ? front.ld_b : front.ld_d;
    if (copy.rows == 3 && copy.cols == 3) copy_sized(copy.kind, from, to, stride, 3, 3);
    else if (copy.rows == 6 && copy.cols == 6) copy_sized(copy.kind, from, to, stride, 6, 6);
    else copy_sized(copy.kind, from, to, stride, copy.rows, copy.cols);
}

// The runs of a child's rows in its parent; those from `remaining` on lie in the update rows.
struct Runs {
    const Run *begin, *remaining, *end;
};

constexpr double kWorthSharing = 4e6;  // flops of a front below which to wake helpers costs more than it saves
constexpr int32_t kRows = 240;         // of a piece in triangular solves

// work(begin, end, worker) for pieces of [0, count), or for all of it at once by the caller where there is no team.
template <class Work>
void share(Team* team, int32_t count, int32_t width, Work work) {
    if (team == nullptr) return work(0, count, 0);
    team->run(static_cast<size_t>((count + width - 1) / width), [&](size_t piece, size_t worker) {
        const int32_t begin = static_cast<int32_t>(piece) * width;
        work(begin, std::min(count, begin + width), worker);
    });
}

}  // namespace

// Returns the scalar column (in elimination order) of a bad pivot, or -1. Each number of a front is computed by the
// same operations in the same order however many share the work, so results do not depend on threads.
int32_t Numeric::factor_front(int32_t s, const double* values, const double* damping, Scratch& own, Team* team) {
    const Front& front = symbolic_.fronts[s];
    const int32_t n = front.pivots;
    double* d = own.square.data();
    if (front.flops < kWorthSharing || n > kDepthBlock) team = nullptr;
    const auto scratch_of = [&](size_t worker) {
        return (team == nullptr ? own : *scratch_[worker]).multiply.data();
    };
    assemble_front(s, values, damping, own, team);
    const int32_t bad = kernels_.cholesky(n, d, front.ld_d, own.multiply.data());
    if (bad >= 0) return front.column + bad;

    WeakestPivot weakest;
    for (int32_t p = 0; p < n; ++p) {
        const double reciprocal = d[p + int64_t{p} * front.ld_d];
        const double ratio = 1.0 / (reciprocal * reciprocal * own.diagonal[p]);
        if (ratio < weakest.ratio) weakest = {ratio, front.column + p};
    }
    weakest_of_[s] = weakest;
    double* triangle = storage_.data() + front.d;
    for (int32_t p = 0; p < n; ++p) {
        const double* column = d + int64_t{p} * front.ld_d;
        triangle = std::copy(column + p, column + n, triangle);
    }
    if (front.updates == 0) return -1;

    double* b = storage_.data() + front.b;
    double* update = storage_.data() + schedule_.update[s];
    share(team, front.updates, kRows, [&](int32_t row, int32_t end, size_t worker) {
        kernels_.solve_transposed(end - row, n, d, front.ld_d, b + row, front.ld_b, scratch_of(worker));
    });
    share(team, front.updates, kPanelColumns, [&](int32_t begin, int32_t end, size_t worker) {
        for (int32_t top = begin; top < end; top += kPanelColumns) {
            const int32_t rows = front.updates - top;
            kernels_.multiply({rows, std::min(rows, kPanelColumns), n, b + top, front.ld_b, b + top, 1, front.ld_b,
                               update + panel_start(top / kPanelColumns, front.ld_b), front.ld_b - top,
                               Product::kSetNegative, true}, scratch_of(worker));
        }
        for_each_child(s, [&](const Front& child, const double* from, const Runs& runs) {
            kernels_.add_to_update(from, child.ld_b, runs.remaining, runs.end, {begin, end}, update, front.ld_b);
        });
    });
    return -1;
}

// What the matrix, the damping and the children say about the columns of the pivots: D in scratch storage, B in place.
void Numeric::assemble_front(int32_t s, const double* values, const double* damping, Scratch& own, Team* team) {
    const Front &front = symbolic_.fronts[s], &next = symbolic_.fronts[s + 1];
    const int32_t n = front.pivots;
    double* d = own.square.data();
    double* b = storage_.data() + front.b;
    std::memset(d, 0, static_cast<size_t>(front.ld_d) * static_cast<size_t>(n) * sizeof(double));
    std::memset(b, 0, static_cast<size_t>(next.d - front.b) * sizeof(double));
    const auto copies_end = static_cast<int64_t>(symbolic_.copies.size());
    for (int64_t q = front.copies; q < next.copies; ++q) {
        // Blocks come in the order of the variables, fronts in the order of elimination: each is far from the last.
        __builtin_prefetch(values + symbolic_.copies[std::min(q + 12, copies_end - 1)].source);
        copy_block(symbolic_.copies[q], values, front, d, b);
    }
    if (damping != nullptr) {
        double* diagonal = d;
        for (int32_t k = front.first; k < front.last; ++k) {
            const double* extra = damping + symbolic_.variable_starts[symbolic_.order[k]];
            const int32_t size = symbolic_.size_at(k);
            for (int32_t i = 0; i < size; ++i, diagonal += front.ld_d + 1) *diagonal += extra[i];
        }
    }
    for (int32_t p = 0; p < n; ++p) own.diagonal[p] = d[p + int64_t{p} * front.ld_d];
    share(team, n, kPanelColumns, [&](int32_t begin, int32_t end, size_t) {
        for_each_child(s, [&](const Front& child, const double* from, const Runs& runs) {
            kernels_.add_to_panel(from, child.ld_b, runs.begin, runs.remaining, runs.end, {begin, end}, d, front.ld_d,
                                  b, front.ld_b);
        });
    });
}

// add(child, its update matrix, how its rows lie in the front) for all children of a front.
template <class Add>
void Numeric::for_each_child(int32_t s, Add add) const {
    const Run* runs = symbolic_.runs.data();
    for (int64_t q = symbolic_.fronts[s].children; q < symbolic_.fronts[s + 1].children; ++q) {
        const int32_t c = symbolic_.children[q];
        const Front& child = symbolic_.fronts[c];
        add(child, storage_.data() + schedule_.update[c],
            Runs{runs + child.runs, runs + child.remaining_runs, runs + symbolic_.fronts[c + 1].runs});
    }
}

}  // namespace clew::linalg
