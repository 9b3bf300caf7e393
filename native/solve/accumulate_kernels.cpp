// The accumulate step of factors that are evaluated elsewhere: residuals and Jacobians in, normal equations out.
#include <algorithm>
#include <vector>

#include "solve/scatter.hpp"

namespace clew::CLEW_ISA {
namespace {

// out (P, Q) += A^T B, or its transpose into (Q, P), for A (D, P), B (D, Q).
inline void add(int dim, int p, int q, const double* a, const double* b, bool transposed, double* out) {
    for (int d = 0; d < dim; ++d)
        for (int i = 0; i < p; ++i)
            for (int k = 0; k < q; ++k)
                out[transposed ? k * p + i : i * q + k] += a[d * p + i] * b[d * q + k];
}

}  // namespace

double accumulate(const Block& block, int arity, int residual_dim, const int* dims, const double* residual,
                  const double* const* jacobians) {
    double cost = 0.0;
    const int D = residual_dim;
    const int pairs = arity * (arity + 1) / 2;
    const int widest = arity ? *std::max_element(dims, dims + arity) : 0;
    std::vector<double> we(D), scratch(static_cast<std::size_t>(arity) * D * widest);
    for (int64_t m = 0; m < block.count; ++m) {
        const double* e = residual + m * D;
        const double* information = block.information + m * D * D;
        double s = 0.0;
        for (int d = 0; d < D; ++d) {
            we[d] = 0.0;
            for (int k = 0; k < D; ++k) we[d] += information[d * D + k] * e[k];
            s += we[d] * e[d];
        }
        const Weighted robust = robustify(block.robust, s, block.scale);
        cost += robust.rho;
        if (!block.hessian_values) continue;
        const int32_t* gradient = block.gradient + m * arity;
        const auto weighted = [&](int p) { return scratch.data() + static_cast<std::size_t>(p) * D * widest; };
        for (int p = 0; p < arity; ++p) {
            if (gradient[p] < 0) continue;
            const double* j = jacobians[p] + m * D * dims[p];
            for (int d = 0; d < D; ++d)
                for (int i = 0; i < dims[p]; ++i) {
                    double sum = 0.0;
                    for (int k = 0; k < D; ++k) sum += information[d * D + k] * j[k * dims[p] + i];
                    weighted(p)[d * dims[p] + i] = robust.weight * sum;
                    block.gradient_values[gradient[p] + i] += robust.weight * j[d * dims[p] + i] * we[d];
                }
        }
        for (int p = 0; p < arity; ++p)
            for (int q = 0; q <= p; ++q) {
                const int64_t target = block.plan[m * pairs + p * (p + 1) / 2 + q];
                if (target < 0) continue;
                const double* j = jacobians[p] + m * D * dims[p];
                double* out = block.hessian_values + (target >> 2);
                const int flag = static_cast<int>(target & 3);
                if (flag != 1) add(D, dims[p], dims[q], j, weighted(q), false, out);
                if (flag != 0) add(D, dims[p], dims[q], j, weighted(q), true, out);
            }
    }
    return cost;
}

}  // namespace clew::CLEW_ISA
