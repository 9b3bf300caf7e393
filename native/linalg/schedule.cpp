#include "linalg/schedule.hpp"

#include <algorithm>

namespace clew::linalg {

namespace {

constexpr double kWorthThreads = 2e7;  // flops below which starting threads costs more than it saves

int64_t update_size(const Front& front) { return (int64_t{front.ld_b} * front.updates + 7) / 8 * 8; }

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

// Two stacks, one for even and one for odd depths: when a front is pushed on the one, its children are the uppermost
// of the other and are dropped. Nothing moves, and the same places serve the way down (selected inverse).
class TwoStacks {
public:
    explicit TwoStacks(int64_t base) : base_(base) {}

    template <class Fronts>
    void place(const Symbolic& symbolic, const std::vector<bool>& odd, const Fronts& fronts,
               const std::vector<bool>& own, std::vector<int64_t>& update) {
        for (int32_t s : fronts) {
            const Front& front = symbolic.fronts[s];
            update[s] = top_[odd[s]];
            top_[odd[s]] += update_size(front);
            peak_[odd[s]] = std::max(peak_[odd[s]], top_[odd[s]]);
            for (int64_t q = front.children; q < symbolic.fronts[s + 1].children; ++q) {
                const int32_t child = symbolic.children[q];
                if (own[child]) top_[odd[child]] -= update_size(symbolic.fronts[child]);
            }
        }
        for (int32_t s : fronts) update[s] += base_ + (odd[s] ? peak_[0] : 0);
    }
    int64_t end() const { return base_ + peak_[0] + peak_[1]; }

private:
    int64_t base_;
    int64_t top_[2] = {0, 0}, peak_[2] = {0, 0};
};

void place_updates(const Symbolic& symbolic, Schedule& schedule) {
    const int32_t count = symbolic.count();
    std::vector<bool> odd(count, false), own(count, false);
    for (int32_t s = count - 1; s >= 0; --s) {
        if (symbolic.fronts[s].parent != -1) odd[s] = !odd[symbolic.fronts[s].parent];
    }
    std::vector<int32_t> fronts;
    for (const Task& task : schedule.tasks) {
        fronts.clear();
        for (int32_t s = task.begin; s < task.end; ++s) {
            fronts.push_back(s);
            own[s] = true;
        }
        TwoStacks stacks(schedule.workspace_size);
        stacks.place(symbolic, odd, fronts, own, schedule.update);
        schedule.workspace_size = stacks.end();
    }
    own.assign(count, false);  // roots of tasks stay in their own stacks
    for (int32_t s : schedule.top) own[s] = true;
    TwoStacks stacks(schedule.workspace_size);
    stacks.place(symbolic, odd, schedule.top, own, schedule.update);
    schedule.workspace_size = stacks.end();
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
