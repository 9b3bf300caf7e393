// Elimination tree of a permuted block graph and the exact column counts of its Cholesky factor.
#pragma once

#include "linalg/graph.hpp"

namespace clew::linalg {

// All in positions of an elimination order that is a postorder of its own tree.
struct EliminationTree {
    std::vector<int32_t> order;     // position -> vertex
    std::vector<int32_t> position;  // vertex -> position
    std::vector<int32_t> parent;    // -1 for a root
    std::vector<int64_t> count;     // scalar rows of the column at and below its diagonal block
    double flops = 0;               // multiplications and additions of the factorisation
    double nonzeros = 0;            // scalar entries of the factor
};

// The tree of an elimination order; the order is changed to an equivalent postorder.
EliminationTree elimination_tree(const BlockGraph& graph, std::vector<int32_t> order);

// Children before parents, subtrees contiguous, children in ascending order; iterative.
std::vector<int32_t> postorder(const std::vector<int32_t>& parent);

}  // namespace clew::linalg
