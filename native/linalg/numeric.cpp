#include "linalg/numeric.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

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

bool all_finite(const double* x, int64_t n) {
    return std::all_of(x, x + n, [](double v) { return std::isfinite(v); });
}

}  // namespace

Numeric::Numeric(const Symbolic& symbolic, int threads, bool keep_updates)
    : symbolic_(symbolic), threads_(threads), keep_updates_(keep_updates),
      schedule_(make_schedule(symbolic, threads, keep_updates ? Updates::kKept : Updates::kTransient)),
      kernels_(CLEW_DISPATCH(dense_kernels)()), storage_(schedule_.storage_size), scratch_(make_states<Scratch>(schedule_)), weakest_of_(symbolic.count()) {}

Numeric::~Numeric() = default;

void Numeric::factorize(const double* values, const double* damping, const std::vector<int32_t>* changed) {
    std::vector<bool> redo(symbolic_.count(), changed == nullptr);
    if (changed != nullptr) {
        for (int32_t v : *changed) {
            for (int32_t s = symbolic_.front_of[symbolic_.position[v]]; s != -1 && !redo[s];
                 s = symbolic_.fronts[s].parent) {
                redo[s] = true;
            }
        }
    }
    // Every task runs to its first failure, so that the first of all does not depend on threads.
    constexpr int32_t kNone = std::numeric_limits<int32_t>::max();
    std::vector<int32_t> failures(schedule_.tasks.size() + 1, kNone);
    for_each_task(schedule_, scratch_, [&](size_t t, Scratch& scratch) {
        for (int32_t s = schedule_.tasks[t].begin; s < schedule_.tasks[t].end && failures[t] == kNone; ++s) {
            const int32_t column = redo[s] ? factor_front(s, values, damping, scratch) : -1;
            if (column >= 0) failures[t] = column;
        }
    });
    int32_t failed = *std::min_element(failures.begin(), failures.end());
    if (!schedule_.top.empty() && failed == kNone) {
        for (int32_t s : schedule_.top) {
            const int32_t column = redo[s] ? factor_front(s, values, damping, *scratch_[0]) : -1;
            if (column < 0) continue;
            failed = column;
            break;
        }
    }
    status_ = Status::kOk;
    failed_variable_ = -1;
    weakest_ = {};
    if (failed == kNone) {
        for (const WeakestPivot& w : weakest_of_) {
            if (w.ratio < weakest_.ratio) weakest_ = w;
        }
        return;
    }
    failed_variable_ = variable_of_column(failed);
    weakest_ = {0.0, failed};
    const bool finite = all_finite(values, symbolic_.values_size) &&
                        (damping == nullptr || all_finite(damping, symbolic_.dim));
    status_ = finite ? Status::kNotPositiveDefinite : Status::kNotFinite;
}

// Assembles and eliminates one front; returns the scalar column (in elimination order) of a bad pivot, or -1.
int32_t Numeric::factor_front(int32_t s, const double* values, const double* damping, Scratch& scratch) {
    const Front& front = symbolic_.fronts[s];
    const Front& next = symbolic_.fronts[s + 1];
    double* d = scratch.square.data();
    double* b = storage_.data() + front.b;
    double* update = storage_.data() + schedule_.update[s];
    const int32_t n = front.pivots;

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
    for (int32_t p = 0; p < n; ++p) scratch.diagonal[p] = d[p + int64_t{p} * front.ld_d];

    const Run* runs = symbolic_.runs.data();
    for (int64_t q = front.children; q < next.children; ++q) {
        const int32_t c = symbolic_.children[q];
        const Front& child = symbolic_.fronts[c];
        kernels_.add_to_panel(storage_.data() + schedule_.update[c], child.ld_b, runs + child.runs,
                              runs + child.remaining_runs, runs + symbolic_.fronts[c + 1].runs, d, front.ld_d, b,
                              front.ld_b);
    }
    const int32_t bad = kernels_.cholesky(n, d, front.ld_d, scratch.multiply.data());
    if (bad >= 0) return front.column + bad;

    WeakestPivot weakest;
    for (int32_t p = 0; p < n; ++p) {
        const double reciprocal = d[p + int64_t{p} * front.ld_d];
        const double ratio = 1.0 / (reciprocal * reciprocal * scratch.diagonal[p]);
        if (ratio < weakest.ratio) weakest = {ratio, front.column + p};
    }
    weakest_of_[s] = weakest;
    double* triangle = storage_.data() + front.d;
    for (int32_t p = 0; p < n; ++p) {
        const double* column = d + int64_t{p} * front.ld_d;
        triangle = std::copy(column + p, column + n, triangle);
    }
    if (front.updates == 0) return -1;

    kernels_.solve_transposed(front.updates, n, d, front.ld_d, b, front.ld_b, scratch.multiply.data());
    for (int32_t top = 0; top < front.updates; top += kPanelColumns) {
        const int32_t rows = front.updates - top;
        kernels_.multiply({rows, std::min(rows, kPanelColumns), n, b + top, front.ld_b, b + top, 1, front.ld_b,
                           update + panel_start(top / kPanelColumns, front.ld_b), front.ld_b - top,
                           Product::kSetNegative, true}, scratch.multiply.data());
    }
    for (int64_t q = front.children; q < next.children; ++q) {
        const int32_t c = symbolic_.children[q];
        const Front& child = symbolic_.fronts[c];
        kernels_.add_to_update(storage_.data() + schedule_.update[c], child.ld_b, runs + child.remaining_runs,
                               runs + symbolic_.fronts[c + 1].runs, update, front.ld_b);
    }
    return -1;
}

const double* Numeric::square(const Front& front, Scratch& scratch) const {
    const double* triangle = d(front);
    for (int32_t p = 0; p < front.pivots; ++p) {
        std::copy_n(triangle, front.pivots - p, scratch.square.data() + p + int64_t{p} * front.ld_d);
        triangle += front.pivots - p;
    }
    return scratch.square.data();
}

int32_t Numeric::variable_of_column(int32_t column) const {
    const auto after = std::upper_bound(symbolic_.starts.begin(), symbolic_.starts.end(), column);
    return symbolic_.order[after - symbolic_.starts.begin() - 1];
}

int32_t Numeric::weakest_variable() const {
    return weakest_.column < 0 ? -1 : variable_of_column(weakest_.column);
}

double Numeric::log_determinant() const {
    double sum = 0;
    for (int32_t s = 0; s < symbolic_.count(); ++s) {
        const Front& front = symbolic_.fronts[s];
        const double* pivot = d(front);
        for (int32_t p = 0; p < front.pivots; ++p) {
            sum -= 2.0 * std::log(*pivot);
            pivot += front.pivots - p;
        }
    }
    return sum;
}

}  // namespace clew::linalg
