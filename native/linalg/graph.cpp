#include "linalg/graph.hpp"

namespace clew::linalg {

BlockGraph::BlockGraph(const PatternView& pattern)
    : vertices(pattern.variables),
      starts(static_cast<size_t>(pattern.variables) + 1, 0),
      weights(pattern.sizes, pattern.sizes + pattern.variables) {
    for (int64_t b = 0; b < pattern.blocks; ++b) {
        if (pattern.rows[b] == pattern.cols[b]) continue;
        ++starts[pattern.rows[b] + 1];
        ++starts[pattern.cols[b] + 1];
    }
    for (int32_t v = 0; v < vertices; ++v) starts[v + 1] += starts[v];
    neighbours.resize(static_cast<size_t>(starts[vertices]));
    blocks.resize(neighbours.size());
    diagonal.resize(static_cast<size_t>(vertices));
    std::vector<int64_t> next(starts.begin(), starts.end() - 1);
    for (int64_t b = 0; b < pattern.blocks; ++b) {
        const int32_t r = pattern.rows[b], c = pattern.cols[b];
        if (r == c) {
            diagonal[r] = b;
            continue;
        }
        blocks[next[r]] = blocks[next[c]] = b;
        neighbours[next[r]++] = c;
        neighbours[next[c]++] = r;
    }
}

}  // namespace clew::linalg
