#include "linalg/schedule.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <set>

#include "linalg/update_matrix.hpp"

namespace clew::linalg {

namespace {

constexpr int kMostThreads = 64;      // the tree is cut for; cut finer, subtrees would be crumbs
constexpr double kWorthThreads = 2e7;  // flops below which starting threads costs more than it saves
constexpr double kShared = 0.6;        // share of a thread by which each more of them speeds a front of the top up
constexpr size_t kLargestTop = 64;     // fronts that are opened in search of a cut, a thread
constexpr int64_t kSmall = 1024;       // doubles of an update matrix that cache holds beside a front

int64_t update_size(const Front& front) { return (update_matrix_size(front.updates, front.ld_b) + 7) / 8 * 8; }

// Roots of subtrees, largest first.
struct Larger {
    const std::vector<double>& work;
    bool operator()(int32_t a, int32_t b) const { return work[a] != work[b] ? work[a] > work[b] : a < b; }
};
using Roots = std::set<int32_t, Larger>;

// Time until the last thread is done when each takes the largest subtree that is left; small ones even things out.
double makespan(const Roots& roots, double total, int threads) {
    std::vector<double> busy(threads, 0);
    size_t left = 8 * busy.size();
    for (auto root = roots.begin(); root != roots.end() && left > 0; ++root, --left) {
        *std::min_element(busy.begin(), busy.end()) += roots.key_comp().work[*root];
    }
    return std::max(*std::max_element(busy.begin(), busy.end()), total / threads);
}

// Cuts the tree into subtrees; what lies above is the top, whose fronts come one after the other and are shared. The
// largest subtree is opened again and again, and the cut taken that promises the earliest end.
void split(const Symbolic& symbolic, int threads, Schedule& schedule) {
    const int32_t count = symbolic.count();
    if (threads == 1 || symbolic.flops < kWorthThreads) {
        if (count > 0) schedule.tasks.push_back({0, count});
        return;
    }
    std::vector<double> work(count, 0);
    std::vector<int32_t> begin(count);
    Roots open(Larger{work});
    for (int32_t s = 0; s < count; ++s) begin[s] = s;
    for (int32_t s = 0; s < count; ++s) {
        const int32_t parent = symbolic.fronts[s].parent;
        work[s] += symbolic.fronts[s].flops;
        if (parent == -1) {
            open.insert(s);
            continue;
        }
        work[parent] += work[s];
        begin[parent] = std::min(begin[parent], begin[s]);
    }
    double below = symbolic.flops, top_time = 0, best_time = std::numeric_limits<double>::infinity();
    size_t best = 0;
    std::vector<bool> above(count, false);
    while (!open.empty()) {
        const double time = makespan(open, below, threads) + top_time;
        if (time < best_time) {
            best_time = time;
            best = schedule.top.size();
        }
        const int32_t s = *open.begin();
        if (top_time > best_time || schedule.top.size() >= kLargestTop * static_cast<size_t>(threads)) break;
        open.erase(open.begin());
        schedule.top.push_back(s);
        below -= symbolic.fronts[s].flops;
        top_time += symbolic.fronts[s].flops / (1 + kShared * (threads - 1));
        for (int64_t q = symbolic.fronts[s].children; q < symbolic.fronts[s + 1].children; ++q) {
            open.insert(symbolic.children[q]);
        }
    }
    schedule.top.resize(best);
    for (int32_t s : schedule.top) above[s] = true;
    std::vector<int32_t> roots;
    for (int32_t s = 0; s < count; ++s) {
        const int32_t parent = symbolic.fronts[s].parent;
        if (!above[s] && (parent == -1 || above[parent])) roots.push_back(s);
    }
    std::sort(roots.begin(), roots.end(), Larger{work});
    for (int32_t s : roots) schedule.tasks.push_back({begin[s], s + 1});
    std::sort(schedule.top.begin(), schedule.top.end());
}

// Storage of which pieces are taken and given back: the lowest gap that is large enough. All lifetimes are known
// beforehand, so places are found once and for all; nothing moves, and the same places serve the way down (selected
// inverse), where lifetimes are mirrored.
class Places {
public:
    Places(int64_t begin, int64_t end) : end_(end) {
        if (begin < end) gaps_.emplace(begin, end - begin);
    }

    // A place from `floor` on.
    int64_t take(int64_t size, int64_t floor) {
        for (auto gap = gaps_.begin(); gap != gaps_.end(); ++gap) {
            const int64_t begin = gap->first, end = begin + gap->second, at = std::max(begin, floor);
            if (end - at < size) continue;
            gaps_.erase(gap);
            if (at > begin) gaps_.emplace(begin, at - begin);
            if (at + size < end) gaps_.emplace(at + size, end - at - size);
            return at;
        }
        // The last gap may reach to the end.
        int64_t at = end_;
        if (!gaps_.empty()) {
            const auto last = std::prev(gaps_.end());
            const int64_t begin = last->first;
            if (begin + last->second == end_) {
                at = std::max(begin, std::min(floor, end_));
                gaps_.erase(last);
                if (at > begin) gaps_.emplace(begin, at - begin);
            }
        }
        end_ = at + size;
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
        gaps_.emplace(at, size);
    }

    // Where the storage ends: beyond everything that was ever taken.
    int64_t end() const { return end_; }

private:
    std::map<int64_t, int64_t> gaps_;  // place -> size
    int64_t end_;
};

// Places for the update matrices of some fronts; those of their children that are marked in `own` are given back. With
// `in_factor`, large ones are put into panels of fronts that come after the parent. Small ones share few places that
// stay in cache.
template <class Fronts>
void place_updates(const Symbolic& symbolic, const Fronts& fronts, const std::vector<bool>& own, bool in_factor,
                   Schedule& schedule) {
    Places far(in_factor ? 0 : schedule.storage_size, schedule.storage_size), near(0, 0);
    std::vector<int32_t> small;
    const auto places_of = [&](int32_t s) -> Places& {
        return in_factor && update_size(symbolic.fronts[s]) < kSmall ? near : far;
    };
    for (int32_t s : fronts) {
        const Front& front = symbolic.fronts[s];
        Places& places = places_of(s);
        const bool far_away = in_factor && &places == &far && front.parent != -1;
        schedule.update[s] = places.take(update_size(front), far_away ? symbolic.fronts[front.parent + 1].d : 0);
        if (&places == &near) small.push_back(s);
        for (int64_t q = front.children; q < symbolic.fronts[s + 1].children; ++q) {
            const int32_t child = symbolic.children[q];
            if (own[child]) places_of(child).give_back(schedule.update[child], update_size(symbolic.fronts[child]));
        }
    }
    for (int32_t s : small) schedule.update[s] += far.end();
    schedule.storage_size = far.end() + near.end();
}

void place_updates(const Symbolic& symbolic, bool in_factor, Schedule& schedule) {
    std::vector<bool> own(symbolic.count(), false);
    for (const Task& task : schedule.tasks) {
        std::vector<int32_t> fronts(task.end - task.begin);
        std::iota(fronts.begin(), fronts.end(), task.begin);
        for (int32_t s : fronts) own[s] = true;
        place_updates(symbolic, fronts, own, in_factor, schedule);
    }
    own.assign(symbolic.count(), false);  // roots of tasks stay where they are
    for (int32_t s : schedule.top) own[s] = true;
    place_updates(symbolic, schedule.top, own, false, schedule);
}

}  // namespace

Schedule make_schedule(const Symbolic& symbolic, int threads, Updates updates) {
    Schedule schedule;
    split(symbolic, std::min(threads, kMostThreads), schedule);
    schedule.update.assign(symbolic.count(), 0);
    schedule.storage_size = updates == Updates::kApart ? 0 : symbolic.factor_size;
    if (updates == Updates::kKept) {
        for (int32_t s = 0; s < symbolic.count(); ++s) {
            schedule.update[s] = schedule.storage_size;
            schedule.storage_size += update_size(symbolic.fronts[s]);
        }
    } else {
        const bool one_task = schedule.top.empty() && schedule.tasks.size() == 1;
        place_updates(symbolic, updates == Updates::kTransient && one_task, schedule);
    }
    return schedule;
}

}  // namespace clew::linalg
