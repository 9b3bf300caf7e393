// In which order and by whom fronts are handled, and where their update matrices live meanwhile.
#pragma once

#include "linalg/symbolic.hpp"

namespace clew::linalg {

// Fronts [begin, end): a subtree that one thread handles on its own.
struct Task {
    int32_t begin, end;
};

struct Schedule {
    std::vector<Task> tasks;        // largest first
    std::vector<int32_t> top;       // the fronts above them, ascending
    std::vector<int64_t> update;    // (fronts) place of each update matrix in the workspace
    int64_t workspace_size = 0;     // doubles
};

// With `keep_updates` all update matrices stay, otherwise a place is used again once the parent has been assembled.
Schedule make_schedule(const Symbolic& symbolic, int threads, bool keep_updates);

}  // namespace clew::linalg
