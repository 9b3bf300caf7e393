// Consecutive scalars of a child's update rows that stay consecutive in its parent.
#pragma once

#include <cstdint>

namespace clew::linalg {

// `length` scalars at `from` of the child lie at `to` of the parent: of its pivots, or of its update rows.
struct Run {
    int32_t from, to, length;
};

}  // namespace clew::linalg
