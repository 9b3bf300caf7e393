#include "linalg/pattern.hpp"

#include <algorithm>

namespace clew::linalg {

BlockList blocks_of_pairs(int32_t variables, const int64_t* i, const int64_t* j, int64_t pairs) {
    std::vector<int64_t> starts(static_cast<size_t>(variables) + 1, 0);
    for (int64_t p = 0; p < pairs; ++p) {
        if (i[p] != j[p]) ++starts[std::min(i[p], j[p]) + 1];
    }
    for (int32_t c = 0; c < variables; ++c) starts[c + 1] += starts[c];
    std::vector<int32_t> below(static_cast<size_t>(starts[variables]));
    std::vector<int64_t> next(starts.begin(), starts.end() - 1);
    for (int64_t p = 0; p < pairs; ++p) {
        if (i[p] != j[p]) below[next[std::min(i[p], j[p])]++] = static_cast<int32_t>(std::max(i[p], j[p]));
    }
    BlockList out;
    out.rows.reserve(below.size() + variables);
    out.cols.reserve(below.size() + variables);
    for (int32_t c = 0; c < variables; ++c) {
        const auto begin = below.begin() + starts[c], end = below.begin() + starts[c + 1];
        std::sort(begin, end);
        const auto last = std::unique(begin, end);
        out.rows.push_back(c);
        out.rows.insert(out.rows.end(), begin, last);
        out.cols.resize(out.rows.size(), c);
    }
    return out;
}

void find_blocks(const int64_t* column_starts, const int32_t* rows, const int64_t* i, const int64_t* j, int64_t pairs,
                 int64_t* found) {
    for (int64_t p = 0; p < pairs; ++p) {
        const int64_t col = std::min(i[p], j[p]), row = std::max(i[p], j[p]);
        const int32_t* end = rows + column_starts[col + 1];
        const int32_t* at = std::lower_bound(rows + column_starts[col], end, row);
        found[p] = at != end && *at == row ? at - rows : -1;
    }
}

}  // namespace clew::linalg
