// Relaxed supernodes: which columns of the factor are eliminated together in one dense front.
#pragma once

#include "linalg/etree.hpp"

namespace clew::linalg {

// Supernodes in elimination order (children before parents); `members` are tree positions, ascending.
struct Supernodes {
    std::vector<int32_t> member_starts;  // (count + 1)
    std::vector<int32_t> members;        // (variables)
    std::vector<int32_t> parent;         // (count), -1 for a root
    int32_t count() const { return static_cast<int32_t>(parent.size()); }
};

Supernodes amalgamate(const BlockGraph& graph, const EliminationTree& tree);

}  // namespace clew::linalg
