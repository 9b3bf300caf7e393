// Spanning forests of graphs, for initial guesses and for naming the parts of a graph.
#pragma once

#include <cstdint>
#include <vector>

namespace clew::solve {

// Nodes in the order in which a breadth-first search reaches them. `parent` and `edge` are -1 for roots; `forward`
// says that the edge points from the parent to the node.
struct Forest {
    std::vector<int64_t> node, parent, edge;
    std::vector<uint8_t> forward;
    std::vector<int64_t> component;  // of each node, numbered by first node reached
};

// All seeds are at depth zero; afterwards each node not yet reached, by number, starts a tree of its own.
Forest breadth_first(int64_t node_count, int64_t edge_count, const int64_t* i, const int64_t* j, int64_t seed_count,
                     const int64_t* seeds);

}  // namespace clew::solve
