// Everything about a factorisation that depends on the pattern alone.
#pragma once

#include <cstdint>
#include <vector>

#include "linalg/graph.hpp"
#include "linalg/run.hpp"

namespace clew::linalg {

// Where one block of the matrix goes in the panel of its front.
struct BlockCopy {
    enum Kind : uint8_t { kStraight, kTransposed, kDiagonal };
    uint32_t source;  // in the values
    uint32_t target;  // in D or B
    uint16_t rows, cols;
    Kind kind;
    bool below;       // to B, not to D
};

// One dense front: `pivots` columns that are eliminated together and `updates` further rows. The factor keeps
//   D: the lower triangle of L11, column after column without gaps, reciprocals on its diagonal
//   B (updates x pivots, leading dimension ld_b): L21, column-major; rows of padding are zero
// D first. While it is worked on, D is a square with leading dimension ld_d in scratch storage. The update matrix
// (update_matrix.hpp) goes to the parent.
struct Front {
    int32_t parent;          // -1 for a root
    int32_t first, last;     // positions of the pivot variables: [first, last)
    int32_t pivots, updates;
    int32_t ld_d, ld_b;
    int32_t column;          // scalar start of the pivots in elimination order
    int64_t d, b;            // in the factor
    int64_t rows;            // first of its update rows, here and in `row_offsets`
    int64_t segments;        // the same rows as runs of consecutive scalars
    int64_t runs;            // how they lie in the parent
    int64_t remaining_runs;  // first of the runs that lie in the parent's update rows
    int64_t copies;
    int64_t children;
    double flops;
};

struct Segment {
    int32_t start, length;
};

struct Symbolic {
    int32_t variables = 0;
    int32_t dim = 0;
    std::vector<int32_t> order;           // position -> variable
    std::vector<int32_t> position;        // variable -> position
    std::vector<int32_t> starts;          // scalar start by position
    std::vector<int32_t> variable_starts; // scalar start by variable
    std::vector<int32_t> front_of;        // position -> front
    std::vector<Front> fronts;            // and one more that closes the ranges
    std::vector<int32_t> rows;            // positions of the update rows of all fronts
    std::vector<int32_t> row_offsets;     // their scalar offsets within the front
    std::vector<Segment> segments;
    std::vector<Run> runs;
    std::vector<BlockCopy> copies;
    std::vector<int32_t> children;
    int64_t factor_size = 0;              // doubles, with padding
    int64_t values_size = 0;
    int32_t largest_pivots = 0, largest_updates = 0;
    int64_t largest_square = 0;           // doubles of D as a square
    double flops = 0;
    double nonzeros = 0;                  // stored entries of L, explicit zeros included

    int32_t count() const { return static_cast<int32_t>(fronts.size()) - 1; }
    int32_t size_at(int32_t position) const { return starts[position + 1] - starts[position]; }
};

// `order`: position -> variable, any elimination order.
Symbolic analyse(const PatternView& pattern, const BlockGraph& graph, std::vector<int32_t> order);

}  // namespace clew::linalg
