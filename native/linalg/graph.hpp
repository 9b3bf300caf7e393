// Adjacency of a block-sparse symmetric matrix: one vertex a variable.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace clew::linalg {

// Lower-triangular blocks sorted by (column, row), diagonal included; views of the caller's arrays.
struct PatternView {
    int32_t variables = 0;
    int64_t blocks = 0;
    const int32_t* sizes = nullptr;    // (variables)
    const int32_t* rows = nullptr;     // (blocks)
    const int32_t* cols = nullptr;     // (blocks)
    const int64_t* offsets = nullptr;  // (blocks + 1)
};

// Both triangles, no diagonal, no repeats.
struct BlockGraph {
    int32_t vertices = 0;
    std::vector<int64_t> starts;      // (vertices + 1)
    std::vector<int32_t> neighbours;  // (starts[vertices])
    std::vector<int64_t> blocks;      // (starts[vertices]) the pattern's block of each neighbour
    std::vector<int64_t> diagonal;    // (vertices) the pattern's diagonal blocks
    std::vector<int32_t> weights;     // (vertices) scalar dimension

    explicit BlockGraph(const PatternView& pattern);
};

}  // namespace clew::linalg
