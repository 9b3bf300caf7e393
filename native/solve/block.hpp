// What the linearisation kernels of every kind share: one block of factors and where its contributions go.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.hpp"

namespace clew::solve {

// Robust losses, numbered as clew.noise numbers them.
enum class Robust : int { none = 0, huber, pseudo_huber, cauchy, geman_mcclure, welsch, tukey, dcs };

// A block of M factors. `rows` (M, arity) are the rows of the variables in their arrays of values; `gradient`
// (M, arity) the offset of each variable in the gradient or -1 if it is constant; `plan` (M, arity (arity + 1) / 2)
// says where J_p^T W J_q goes for positions p >= q in the order (0,0), (1,0), (1,1), (2,0), ...:
// -1 nowhere, else 4 * offset + flag with flag 0: as it is, 1: transposed, 2: plus its transpose (p and q are
// one variable, off the diagonal of the factor).
struct Block {
    int64_t count = 0;
    const int32_t* rows = nullptr;
    const double* measurement = nullptr;
    const double* information = nullptr;
    const int32_t* gradient = nullptr;
    const int64_t* plan = nullptr;
    Robust robust = Robust::none;
    double scale = 1.0;
    double* hessian_values = nullptr;  // null: only the cost is wanted
    double* gradient_values = nullptr;
};

}  // namespace clew::solve

// Cost of a block, for each kind; with hessian_values also adds J^T W J and J^T W e.
CLEW_DECLARE(
    double between_se2(const clew::solve::Block& block, const double* from, const double* to);
    double between_se3(const clew::solve::Block& block, const double* from, const double* to);
    double point_observation_2d(const clew::solve::Block& block, const double* poses, const double* points,
                                const double* sensor);
    double point_observation_3d(const clew::solve::Block& block, const double* poses, const double* points,
                                const double* sensor);
    double range_bearing_2d(const clew::solve::Block& block, const double* poses, const double* points,
                            const double* sensor);
    double accumulate(const clew::solve::Block& block, int arity, int residual_dim, const int* dims,
                      const double* residual, const double* const* jacobians);
    void retract_se2(int64_t count, const double* values, const int32_t* offsets, const double* delta, double* out);
    void retract_se3(int64_t count, const double* values, const int32_t* offsets, const double* delta, double* out);
    void compose_tree_se2(int64_t count, const int64_t* node, const int64_t* parent, const int64_t* edge,
                          const uint8_t* forward, const double* measurement, double* values);
    void compose_tree_se3(int64_t count, const int64_t* node, const int64_t* parent, const int64_t* edge,
                          const uint8_t* forward, const double* measurement, double* values);)
