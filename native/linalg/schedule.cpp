#include "linalg/schedule.hpp"

#include <algorithm>
#include <map>
#include <numeric>

#include "linalg/update_matrix.hpp"

namespace clew::linalg {

namespace {

constexpr double kWorthThreads = 2e7;  // flops below which starting threads costs more than it saves

int64_t update_size(const Front& front) { return (update_matrix_size(front.updates, front.ld_b) + 7) / 8 * 8; }

// Cuts the tree into subtrees of at most a fraction of the work; what lies above is the top.
void split(const Symbolic& symbolic, int threads, Schedule& schedule) {
    const int32_t count = symbolic.count();
    std::vector<double> work(count, 0);
    std::vector<int32_t> begin(count);
    for (int32_t s = 0; s < count; ++s) begin[s] = s;
    std::vector<int32_t> roots;
    for (int32_t s = 0; s < count; ++s) {
        const Front& front = symbolic.fronts[s];
        work[s] += front.flops;
        if (front.parent == -1) {
            roots.push_back(s);
            continue;
        }
        work[front.parent] += work[s];
        begin[front.parent] = std::min(begin[front.parent], begin[s]);
    }
    if (threads == 1 || symbolic.flops < kWorthThreads) {
        if (count > 0) schedule.tasks.push_back({0, count});
        return;
    }
    const double limit = symbolic.flops / (8.0 * threads);
    while (!roots.empty()) {
        const int32_t s = roots.back();
        roots.pop_back();
        if (work[s] <= limit) {
            schedule.tasks.push_back({begin[s], s + 1});
            continue;
        }
        schedule.top.push_back(s);
        for (int64_t q = symbolic.fronts[s].children; q < symbolic.fronts[s + 1].children; ++q) {
            roots.push_back(symbolic.children[q]);
        }
    }
    std::sort(schedule.top.begin(), schedule.top.end());
    std::sort(schedule.tasks.begin(), schedule.tasks.end(), [&](const Task& a, const Task& b) {
        const double work_a = work[a.end - 1], work_b = work[b.end - 1];
        return work_a != work_b ? work_a > work_b : a.begin < b.begin;
    });
}

// Storage of which pieces are taken and given back: the lowest gap that is large enough. All lifetimes are known
// beforehand, so places are found once and for all; nothing moves, and the same places serve the way down (selected
// inverse), where lifetimes are mirrored.
class Places {
public:
    explicit Places(int64_t base) : end_(base), peak_(base) {}

    int64_t take(int64_t size) {
        for (auto gap = gaps_.begin(); gap != gaps_.end(); ++gap) {
            if (gap->second < size) continue;
            const int64_t at = gap->first, left = gap->second - size;
            gaps_.erase(gap);
            if (left > 0) gaps_.emplace(at + size, left);
            return at;
        }
        const int64_t at = end_;
        end_ += size;
        peak_ = std::max(peak_, end_);
        return at;
    }

    void give_back(int64_t at, int64_t size) {
        if (size == 0) return;
        auto after = gaps_.lower_bound(at);
        if (after != gaps_.end() && after->first == at + size) {
            size += after->second;
            after = gaps_.erase(after);
        }
        if (after != gaps_.begin() && std::prev(after)->first + std::prev(after)->second == at) {
            --after;
            at = after->first;
            size += after->second;
            gaps_.erase(after);
        }
        if (at + size == end_) end_ = at;
        else gaps_.emplace(at, size);
    }

    int64_t peak() const { return peak_; }

private:
    std::map<int64_t, int64_t> gaps_;  // place -> size
    int64_t end_, peak_;
};

// Places for the update matrices of some fronts; those of their children that are marked in `own` are given back.
template <class Fronts>
void place_updates(const Symbolic& symbolic, const Fronts& fronts, const std::vector<bool>& own, Schedule& schedule) {
    Places places(schedule.workspace_size);
    for (int32_t s : fronts) {
        const Front& front = symbolic.fronts[s];
        schedule.update[s] = places.take(update_size(front));
        for (int64_t q = front.children; q < symbolic.fronts[s + 1].children; ++q) {
            const int32_t child = symbolic.children[q];
            if (own[child]) places.give_back(schedule.update[child], update_size(symbolic.fronts[child]));
        }
    }
    schedule.workspace_size = places.peak();
}

void place_updates(const Symbolic& symbolic, Schedule& schedule) {
    std::vector<bool> own(symbolic.count(), false);
    for (const Task& task : schedule.tasks) {
        std::vector<int32_t> fronts(task.end - task.begin);
        std::iota(fronts.begin(), fronts.end(), task.begin);
        for (int32_t s : fronts) own[s] = true;
        place_updates(symbolic, fronts, own, schedule);
    }
    own.assign(symbolic.count(), false);  // roots of tasks stay where they are
    for (int32_t s : schedule.top) own[s] = true;
    place_updates(symbolic, schedule.top, own, schedule);
}

}  // namespace

Schedule make_schedule(const Symbolic& symbolic, int threads, bool keep_updates) {
    Schedule schedule;
    split(symbolic, threads, schedule);
    schedule.update.assign(symbolic.count(), 0);
    if (keep_updates) {
        for (int32_t s = 0; s < symbolic.count(); ++s) {
            schedule.update[s] = schedule.workspace_size;
            schedule.workspace_size += update_size(symbolic.fronts[s]);
        }
    } else {
        place_updates(symbolic, schedule);
    }
    return schedule;
}

}  // namespace clew::linalg
