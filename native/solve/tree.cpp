#include "solve/tree.hpp"

namespace clew::solve {

Forest breadth_first(int64_t node_count, int64_t edge_count, const int64_t* i, const int64_t* j, int64_t seed_count,
                     const int64_t* seeds) {
    // adjacency in compressed rows, edges of a node in the order of their numbers
    std::vector<int64_t> start(node_count + 1, 0), incident(2 * edge_count);
    for (int64_t e = 0; e < edge_count; ++e) {
        ++start[i[e] + 1];
        ++start[j[e] + 1];
    }
    for (int64_t n = 0; n < node_count; ++n) start[n + 1] += start[n];
    std::vector<int64_t> next(start.begin(), start.end() - 1);
    for (int64_t e = 0; e < edge_count; ++e) {
        incident[next[i[e]]++] = e;
        incident[next[j[e]]++] = e;
    }

    Forest forest;
    forest.component.assign(node_count, -1);
    int64_t components = 0;
    auto reach = [&](int64_t node, int64_t parent, int64_t edge, bool forward, int64_t component) {
        forest.component[node] = component;
        forest.node.push_back(node);
        forest.parent.push_back(parent);
        forest.edge.push_back(edge);
        forest.forward.push_back(forward);
    };
    for (int64_t s = 0; s < seed_count; ++s)
        if (forest.component[seeds[s]] < 0) reach(seeds[s], -1, -1, true, components++);
    std::size_t head = 0;
    for (int64_t root = 0;; ++root) {
        for (; head < forest.node.size(); ++head) {
            const int64_t node = forest.node[head];
            for (int64_t k = start[node]; k < start[node + 1]; ++k) {
                const int64_t e = incident[k];
                const bool forward = i[e] == node;
                const int64_t other = forward ? j[e] : i[e];
                if (forest.component[other] < 0) reach(other, node, e, forward, forest.component[node]);
            }
        }
        while (root < node_count && forest.component[root] >= 0) ++root;
        if (root >= node_count) break;
        reach(root, -1, -1, true, components++);
    }
    return forest;
}

}  // namespace clew::solve
