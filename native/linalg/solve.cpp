// Forward and back substitution on the panels of the factor.
#include <algorithm>

#include "linalg/numeric.hpp"

namespace clew::linalg {

void Numeric::solve(double* rhs) const {
    const Symbolic& sym = symbolic_;
    Buffer permuted(sym.dim), update(sym.largest_updates + 8);
    double* x = permuted.data();
    double* t = update.data();
    for (int32_t k = 0; k < sym.variables; ++k) {
        std::copy_n(rhs + sym.variable_starts[sym.order[k]], sym.size_at(k), x + sym.starts[k]);
    }
    for (int32_t s = 0; s < sym.count(); ++s) {
        const Front& f = sym.fronts[s];
        kernels_.forward(f.pivots, d(f), f.updates, b(f), f.ld_b, x + f.column, t);
        const double* from = t;
        for (int64_t q = f.segments; q < sym.fronts[s + 1].segments; ++q) {
            double* to = x + sym.segments[q].start;
            for (int32_t i = 0; i < sym.segments[q].length; ++i) to[i] -= *from++;
        }
    }
    for (int32_t s = sym.count() - 1; s >= 0; --s) {
        const Front& f = sym.fronts[s];
        double* to = t;
        for (int64_t q = f.segments; q < sym.fronts[s + 1].segments; ++q) {
            to = std::copy_n(x + sym.segments[q].start, sym.segments[q].length, to);
        }
        std::fill_n(to, 3, 0.0);  // rows of padding
        kernels_.backward(f.pivots, d(f), f.updates, b(f), f.ld_b, x + f.column, t);
    }
    for (int32_t k = 0; k < sym.variables; ++k) {
        std::copy_n(x + sym.starts[k], sym.size_at(k), rhs + sym.variable_starts[sym.order[k]]);
    }
}

// Right-hand sides lie side by side in rows of `ld` numbers: seen as a transposed (columns x dim) matrix they are tall
// operands of the same kernels that factor the panels.
void Numeric::solve_many(double* rhs, int32_t columns) const {
    const Symbolic& sym = symbolic_;
    const int64_t ld = (columns + 3) / 4 * 4;
    Buffer permuted(sym.dim * ld), update(sym.largest_updates * ld);
    Scratch scratch(sym);
    double* x = permuted.data();
    double* t = update.data();
    std::fill_n(x, sym.dim * ld, 0.0);
    const auto each_row = [&](auto move) {
        for (int32_t k = 0; k < sym.variables; ++k) {
            const int64_t start = sym.variable_starts[sym.order[k]];
            for (int64_t i = 0; i < sym.size_at(k); ++i) {
                move(rhs + (start + i) * columns, x + (sym.starts[k] + i) * ld);
            }
        }
    };
    each_row([&](const double* outside, double* inside) { std::copy_n(outside, columns, inside); });
    for (int32_t s = 0; s < sym.count(); ++s) {
        const Front& f = sym.fronts[s];
        double* pivots = x + f.column * ld;
        kernels_.solve_transposed(columns, f.pivots, square(f, scratch), f.ld_d, pivots, ld, scratch.multiply.data());
        kernels_.multiply({columns, f.updates, f.pivots, pivots, ld, b(f), 1, f.ld_b, t, ld, Product::kSetNegative,
                           false}, scratch.multiply.data());
        const double* from = t;
        for (int64_t q = f.segments; q < sym.fronts[s + 1].segments; ++q) {
            double* to = x + sym.segments[q].start * ld;
            for (int64_t i = 0; i < sym.segments[q].length * ld; ++i) to[i] += *from++;
        }
    }
    for (int32_t s = sym.count() - 1; s >= 0; --s) {
        const Front& f = sym.fronts[s];
        double* pivots = x + f.column * ld;
        double* to = t;
        for (int64_t q = f.segments; q < sym.fronts[s + 1].segments; ++q) {
            to = std::copy_n(x + sym.segments[q].start * ld, sym.segments[q].length * ld, to);
        }
        if (f.updates > 0) {
            kernels_.multiply({columns, f.pivots, f.updates, t, ld, b(f), f.ld_b, 1, pivots, ld, Product::kSubtract,
                               false}, scratch.multiply.data());
        }
        kernels_.solve_straight(columns, f.pivots, square(f, scratch), f.ld_d, pivots, ld, scratch.multiply.data());
    }
    each_row([&](double* outside, const double* inside) { std::copy_n(inside, columns, outside); });
}

}  // namespace clew::linalg
