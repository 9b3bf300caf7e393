// Approximate minimum degree ordering of a weighted graph.
#pragma once

#include "linalg/graph.hpp"

namespace clew::linalg {

// Elimination order: position -> vertex. Degrees are counted in scalar dimensions.
// Amestoy, Davis, Duff, "An approximate minimum degree ordering algorithm", SIAM J. Matrix Anal. Appl. 17 (1996).
std::vector<int32_t> approximate_minimum_degree(const BlockGraph& graph);

}  // namespace clew::linalg
