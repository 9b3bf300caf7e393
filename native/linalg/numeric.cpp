#include "linalg/numeric.hpp"

#include <algorithm>
#include <cmath>

namespace clew::linalg {

namespace {

bool all_finite(const double* x, int64_t n) {
    return std::all_of(x, x + n, [](double v) { return std::isfinite(v); });
}

}  // namespace

Numeric::Numeric(const Symbolic& symbolic, int threads, bool keep_updates)
    : symbolic_(symbolic), threads_(threads), keep_updates_(keep_updates),
      schedule_(make_schedule(symbolic, threads, keep_updates ? Updates::kKept : Updates::kTransient)),
      kernels_(CLEW_DISPATCH(dense_kernels)()), storage_(schedule_.storage_size),
      scratch_(make_states<Scratch>(schedule_)), weakest_of_(symbolic.count()) {}

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
    Team team(scratch_.size());
    team.run(schedule_.tasks.size(), [&](size_t t, size_t worker) {
        for (int32_t s = schedule_.tasks[t].begin; s < schedule_.tasks[t].end && failures[t] == kNone; ++s) {
            const int32_t column = redo[s] ? factor_front(s, values, damping, *scratch_[worker], nullptr) : -1;
            if (column >= 0) failures[t] = column;
        }
    });
    int32_t failed = *std::min_element(failures.begin(), failures.end());
    for (size_t q = 0; q < schedule_.top.size() && symbolic_.fronts[schedule_.top[q]].column < failed; ++q) {
        const int32_t s = schedule_.top[q];
        const int32_t column = redo[s] ? factor_front(s, values, damping, *scratch_[0], &team) : -1;
        if (column >= 0) failed = column;
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
