// Building and searching block patterns.
#pragma once

#include <cstdint>
#include <vector>

namespace clew::linalg {

struct BlockList {
    std::vector<int32_t> rows, cols;
};

// Lower-triangular blocks of all pairs and the diagonal, unique, sorted by column, then row.
BlockList blocks_of_pairs(int32_t variables, const int64_t* i, const int64_t* j, int64_t pairs);

// Index of the block of each pair, or -1. `column_starts` (variables + 1) belongs to rows sorted as above.
void find_blocks(const int64_t* column_starts, const int32_t* rows, const int64_t* i, const int64_t* j, int64_t pairs,
                 int64_t* found);

}  // namespace clew::linalg
