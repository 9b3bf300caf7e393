// The numeric factor of one matrix and what can be asked of it.
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "linalg/buffer.hpp"
#include "linalg/dense.hpp"
#include "linalg/schedule.hpp"
#include "linalg/team.hpp"

namespace clew::linalg {

enum class Status { kOk = 0, kNotPositiveDefinite = 1, kNotFinite = 2 };

// The smallest ratio of a pivot to the diagonal entry that it was before elimination, and the scalar column (in
// elimination order) where it occurs.
struct WeakestPivot {
    double ratio = std::numeric_limits<double>::infinity();
    int32_t column = -1;
};

// A block of the inverse: rows of the variable at position `row`, columns of the one at `col`, `row >= col`, written
// row-major to `target`, transposed if asked.
struct InverseBlock {
    int32_t row, col;
    bool transposed;
    int64_t target;
};

class Numeric {
public:
    Numeric(const Symbolic& symbolic, int threads, bool keep_updates);
    ~Numeric();

    // `damping` (dim, in the order of the variables) may be null. `changed` marks the variables whose blocks differ
    // from the last call, which must have ended well with kept updates; null means all.
    void factorize(const double* values, const double* damping, const std::vector<int32_t>* changed);

    void solve(double* x) const;                            // (dim), in place
    void solve_many(double* x, int32_t columns) const;      // (dim, columns) row-major, in place
    double log_determinant() const;

    // Takahashi's selected inverse; `wanted` is sorted by `col` and lies within the factor's pattern.
    void inverse_blocks(const std::vector<InverseBlock>& wanted, double* out);
    // Whether the factor stores the block of two positions.
    bool stores(int32_t row, int32_t col) const;
    // Dense covariance (d, d), row-major, of variables in their given order.
    void joint_covariance(const std::vector<int32_t>& variables, double* out) const;

    const Symbolic& symbolic() const { return symbolic_; }
    bool keeps_updates() const { return keep_updates_; }
    Status status() const { return status_; }
    int32_t failed_variable() const { return failed_variable_; }
    double weakest_ratio() const { return weakest_.ratio; }
    int32_t weakest_variable() const;

private:
    struct Scratch;
    class InverseFront;
    int32_t factor_front(int32_t s, const double* values, const double* damping, Scratch& own, Team* team);
    void assemble_front(int32_t s, const double* values, const double* damping, Scratch& own, Team* team);
    template <class Add>
    void for_each_child(int32_t s, Add add) const;
    int32_t variable_of_column(int32_t column) const;
    template <class State>
    std::vector<std::unique_ptr<State>> make_states(const Schedule& schedule) const;

    const double* square(const Front& front, Scratch& scratch) const;  // D with leading dimension ld_d, in scratch
    const double* d(const Front& front) const { return storage_.data() + front.d; }
    const double* b(const Front& front) const { return storage_.data() + front.b; }

    const Symbolic& symbolic_;
    int threads_;
    bool keep_updates_;
    Schedule schedule_;
    const DenseKernels& kernels_;
    Buffer storage_;  // the factor, and update matrices where the schedule puts them
    std::vector<std::unique_ptr<Scratch>> scratch_;  // kept: to touch fresh memory costs as much as a small factor
    std::vector<WeakestPivot> weakest_of_;  // (fronts)
    WeakestPivot weakest_;
    Status status_ = Status::kOk;
    int32_t failed_variable_ = -1;
};

// Storage of one thread for the dense kernels.
struct Numeric::Scratch {
    explicit Scratch(const Symbolic& symbolic)
        : multiply(CLEW_DISPATCH(multiply_scratch)()),
          square(symbolic.largest_square), diagonal(static_cast<size_t>(symbolic.largest_pivots)) {}
    Buffer multiply, square;
    std::vector<double> diagonal;
};

// One state for each thread that has something to do, made before threads start so that running out of memory stays an
// exception.
template <class State>
std::vector<std::unique_ptr<State>> Numeric::make_states(const Schedule& schedule) const {
    const bool alone = schedule.top.empty() && schedule.tasks.size() < 2;
    const size_t threads = alone ? 1 : Team::most(static_cast<size_t>(threads_));
    std::vector<std::unique_ptr<State>> states;
    for (size_t t = 0; t < threads; ++t) states.push_back(std::make_unique<State>(symbolic_));
    return states;
}

}  // namespace clew::linalg
