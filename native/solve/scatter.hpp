// Robust weighting and adding into the block Hessian; included by *_kernels.cpp only, inside their namespace.
#pragma once

#include <math.h>

#include "solve/block.hpp"

namespace clew::CLEW_ISA {
namespace {

using solve::Block;
using solve::Robust;

struct Weighted {
    double rho;
    double weight;  // rho'(s)
};

inline Weighted robustify(Robust kind, double s, double c) {
    const double c2 = c * c;
    switch (kind) {
        case Robust::none: break;
        case Robust::huber:
            if (s > c2) {
                const double r = sqrt(s);
                return {2.0 * c * r - c2, c / r};
            }
            break;
        case Robust::pseudo_huber: {
            const double r = sqrt(1.0 + s / c2);
            return {2.0 * s / (r + 1.0), 1.0 / r};
        }
        case Robust::cauchy: return {c2 * log1p(s / c2), c2 / (c2 + s)};
        case Robust::geman_mcclure: {
            const double w = c2 / (c2 + s);
            return {s * w, w * w};
        }
        case Robust::welsch: return {-c2 * expm1(-s / c2), exp(-s / c2)};
        case Robust::tukey: {
            if (s > c2) return {c2 / 3.0, 0.0};
            const double u = s / c2;
            return {s * (1.0 - u * (1.0 - u / 3.0)), (1.0 - u) * (1.0 - u)};
        }
        case Robust::dcs:
            if (s > c) {  // this scale is of squared residuals
                const double w = 2.0 * c / (c + s);
                return {c * (3.0 - 2.0 * w), w * w};
            }
            break;
    }
    return {s, 1.0};
}

// out (Q, P) += A^T B for A (D, Q), B (D, P).
template <int D, int Q, int P>
inline void add_product(const double* a, const double* b, double* out) {
    for (int q = 0; q < Q; ++q) {
        double row[P];
        for (int p = 0; p < P; ++p) row[p] = out[q * P + p];
        for (int d = 0; d < D; ++d)
            for (int p = 0; p < P; ++p) row[p] += a[d * Q + q] * b[d * P + p];
        for (int p = 0; p < P; ++p) out[q * P + p] = row[p];
    }
}

// out (D, P) = w A B for A (D, D), B (D, P).
template <int D, int P>
inline void weigh(double w, const double* a, const double* b, double* out) {
    for (int d = 0; d < D; ++d) {
        double row[P] = {};
        for (int k = 0; k < D; ++k)
            for (int p = 0; p < P; ++p) row[p] += a[d * D + k] * b[k * P + p];
        for (int p = 0; p < P; ++p) out[d * P + p] = w * row[p];
    }
}

// Where J_p^T W J_q of different positions goes.
template <int D, int P, int Q>
inline void add_pair(int64_t target, const double* jp, const double* wjp, const double* jq, const double* wjq,
                     double* values) {
    if (target < 0) return;
    double* out = values + (target >> 2);
    switch (target & 3) {
        case 0: add_product<D, P, Q>(jp, wjq, out); break;
        case 1: add_product<D, Q, P>(jq, wjp, out); break;
        default:
            if constexpr (P == Q) {
                add_product<D, P, Q>(jp, wjq, out);
                add_product<D, Q, P>(jq, wjp, out);
            }
    }
}

// One pass over a block of factors with residual dimension D and one (P = 0) or two variables of dimensions O and P.
// `model(m, residual, j0, j1)` evaluates factor m; Jacobians are (D, O) and (D, P), null when only the cost counts.
template <int D, int O, int P, class Model>
double linearise(const Block& block, const Model& model) {
    double cost = 0.0;
    const bool full = block.hessian_values != nullptr;
    for (int64_t m = 0; m < block.count; ++m) {
        double e[D], j0[D * O], j1[D * P];
        if (full) model.template evaluate<true>(m, e, j0, j1);
        else model.template evaluate<false>(m, e, j0, j1);
        const double* information = block.information + m * D * D;
        double we[D];
        double s = 0.0;
        for (int d = 0; d < D; ++d) {
            double sum = 0.0;
            for (int k = 0; k < D; ++k) sum += information[d * D + k] * e[k];
            we[d] = sum;
            s += sum * e[d];
        }
        const Weighted robust = robustify(block.robust, s, block.scale);
        cost += robust.rho;
        if (!full) continue;
        for (int d = 0; d < D; ++d) we[d] *= robust.weight;
        const int32_t* gradient = block.gradient + m * 2;
        const int64_t* plan = block.plan + m * 3;
        double w0[D * O], w1[D * P];
        if (gradient[0] >= 0) {
            weigh<D, O>(robust.weight, information, j0, w0);
            double* g = block.gradient_values + gradient[0];
            for (int d = 0; d < D; ++d)
                for (int o = 0; o < O; ++o) g[o] += j0[d * O + o] * we[d];
            add_product<D, O, O>(j0, w0, block.hessian_values + (plan[0] >> 2));
        }
        if (gradient[1] >= 0) {
            weigh<D, P>(robust.weight, information, j1, w1);
            double* g = block.gradient_values + gradient[1];
            for (int d = 0; d < D; ++d)
                for (int p = 0; p < P; ++p) g[p] += j1[d * P + p] * we[d];
            add_product<D, P, P>(j1, w1, block.hessian_values + (plan[2] >> 2));
        }
        add_pair<D, P, O>(plan[1], j1, w1, j0, w0, block.hessian_values);
    }
    return cost;
}

}  // namespace
}  // namespace clew::CLEW_ISA
