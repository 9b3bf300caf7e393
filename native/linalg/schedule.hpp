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
    std::vector<int64_t> update;    // (fronts) place of each update matrix in the storage
    int64_t storage_size = 0;       // doubles
};

// Where update matrices live.
enum class Updates {
    kTransient,  // behind the factor or, with one thread, in panels that are not filled yet; the place of one is used
                 // again once its parent has been assembled
    kKept,       // behind the factor; all stay
    kApart,      // in a storage of their own, places used again
};

Schedule make_schedule(const Symbolic& symbolic, int threads, Updates updates);

}  // namespace clew::linalg
