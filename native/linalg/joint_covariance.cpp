// Dense covariance of a few variables: E^T (L L^T)^-1 E = Y^T Y with Y = L^-1 E, where only the fronts on the paths
// from the variables to the roots of the tree take part.
#include <algorithm>

#include "linalg/numeric.hpp"

namespace clew::linalg {

void Numeric::joint_covariance(const std::vector<int32_t>& variables, double* out) const {
    const Symbolic& sym = symbolic_;
    std::vector<int32_t> reach, base(sym.count(), -1);
    int32_t columns = 0;
    for (int32_t v : variables) {
        columns += sym.size_at(sym.position[v]);
        for (int32_t s = sym.front_of[sym.position[v]]; s != -1 && base[s] == -1; s = sym.fronts[s].parent) {
            base[s] = 0;
            reach.push_back(s);
        }
    }
    if (columns == 0) return;
    std::sort(reach.begin(), reach.end());
    int32_t depth = 0, updates = 0;
    for (int32_t s : reach) {
        base[s] = depth;
        depth += sym.fronts[s].pivots;
        updates = std::max(updates, sym.fronts[s].updates);
    }
    const auto row_of = [&](int32_t position) {
        const int32_t s = sym.front_of[position];
        return base[s] + sym.starts[position] - sym.fronts[s].column;
    };
    const int64_t ld = (columns + 3) / 4 * 4;
    Buffer rhs(depth * ld), update(updates * ld), product(ld * columns);
    Scratch scratch(sym);
    double* y = rhs.data();
    std::fill_n(y, depth * ld, 0.0);
    int32_t column = 0;
    for (int32_t v : variables) {
        const int32_t row = row_of(sym.position[v]), size = sym.size_at(sym.position[v]);
        for (int32_t i = 0; i < size; ++i) y[(row + i) * ld + column++] = 1.0;
    }
    for (int32_t s : reach) {
        const Front& f = sym.fronts[s];
        double* pivots = y + base[s] * ld;
        kernels_.solve_transposed(columns, f.pivots, square(f, scratch), f.ld_d, pivots, ld, scratch.multiply.data());
        kernels_.multiply({columns, f.updates, f.pivots, pivots, ld, b(f), 1, f.ld_b, update.data(), ld,
                           Product::kSetNegative, false}, scratch.multiply.data());
        const double* from = update.data();
        for (int64_t q = f.rows; q < sym.fronts[s + 1].rows; ++q) {
            double* to = y + row_of(sym.rows[q]) * ld;
            for (int64_t i = 0; i < sym.size_at(sym.rows[q]) * ld; ++i) to[i] += *from++;
        }
    }
    kernels_.multiply({columns, columns, depth, y, ld, y, 1, ld, product.data(), ld, Product::kSetNegative, true},
                      scratch.multiply.data());
    for (int32_t i = 0; i < columns; ++i) {
        for (int32_t j = 0; j <= i; ++j) {
            out[int64_t{i} * columns + j] = out[int64_t{j} * columns + i] = -product.data()[i + j * ld];
        }
    }
}

}  // namespace clew::linalg
