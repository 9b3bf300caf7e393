#include "linalg/symbolic.hpp"

#include <algorithm>
#include <stdexcept>

#include "linalg/supernodes.hpp"

namespace clew::linalg {

namespace {

// Columns start on a whole vector; leading dimensions that are multiples of 64 would map a row to few cache sets.
int32_t leading_dimension(int32_t rows) {
    int32_t ld = rows <= 32 ? (rows + 3) / 4 * 4 : (rows + 7) / 8 * 8;
    if (ld >= 128 && ld % 64 == 0) ld += 8;
    return ld;
}

int64_t round_up(int64_t n) { return (n + 7) / 8 * 8; }

class Analysis {
public:
    Analysis(const PatternView& pattern, const BlockGraph& graph, std::vector<int32_t> order)
        : pattern_(pattern), graph_(graph), tree_(elimination_tree(graph, std::move(order))),
          supernodes_(amalgamate(graph, tree_)), mark_(graph.vertices, -1), offset_(graph.vertices, 0) {}

    Symbolic run() {
        number_variables();
        out_.fronts.resize(static_cast<size_t>(supernodes_.count()) + 1);
        list_children();
        out_.copies.reserve(static_cast<size_t>(pattern_.blocks));
        for (int32_t s = 0; s < supernodes_.count(); ++s) {
            Front& front = out_.fronts[s];
            front.parent = supernodes_.parent[s];
            front.first = supernodes_.member_starts[s];
            front.last = supernodes_.member_starts[s + 1];
            collect_rows(s);
            lay_out(front);
            plan_copies(front);
        }
        close_ranges();
        plan_runs();
        for (auto* list : {&out_.rows, &out_.row_offsets}) list->shrink_to_fit();  // they stay as long as the structure
        out_.segments.shrink_to_fit();
        out_.runs.shrink_to_fit();
        return std::move(out_);
    }

private:
    void number_variables() {
        const int32_t n = graph_.vertices;
        out_.variables = n;
        out_.values_size = pattern_.offsets[pattern_.blocks];
        out_.order.resize(n);
        out_.position.resize(n);
        out_.front_of.resize(n);
        out_.starts.assign(static_cast<size_t>(n) + 1, 0);
        out_.variable_starts.assign(static_cast<size_t>(n) + 1, 0);
        for (int32_t s = 0; s < supernodes_.count(); ++s) {
            for (int32_t k = supernodes_.member_starts[s]; k < supernodes_.member_starts[s + 1]; ++k) {
                out_.order[k] = tree_.order[supernodes_.members[k]];
                out_.position[out_.order[k]] = k;
                out_.front_of[k] = s;
            }
        }
        for (int32_t k = 0; k < n; ++k) {
            out_.starts[k + 1] = out_.starts[k] + graph_.weights[out_.order[k]];
            out_.variable_starts[k + 1] = out_.variable_starts[k] + graph_.weights[k];
        }
        out_.dim = out_.starts[n];
    }

    void list_children() {
        std::vector<int64_t> starts(static_cast<size_t>(supernodes_.count()) + 1, 0);
        for (int32_t p : supernodes_.parent) {
            if (p != -1) ++starts[p + 1];
        }
        for (int32_t s = 0; s < supernodes_.count(); ++s) starts[s + 1] += starts[s];
        for (int32_t s = 0; s <= supernodes_.count(); ++s) out_.fronts[s].children = starts[s];
        out_.children.resize(static_cast<size_t>(starts.back()));
        for (int32_t s = 0; s < supernodes_.count(); ++s) {
            if (supernodes_.parent[s] != -1) out_.children[starts[supernodes_.parent[s]]++] = s;
        }
    }

    // Update rows: neighbours of the pivots and update rows of the children, beyond the pivots.
    void collect_rows(int32_t s) {
        Front& front = out_.fronts[s];
        front.rows = static_cast<int64_t>(out_.rows.size());
        const auto take = [&](int32_t position) {
            if (position < front.last || mark_[position] == s) return;
            mark_[position] = s;
            out_.rows.push_back(position);
        };
        for (int32_t k = front.first; k < front.last; ++k) {
            const int32_t v = out_.order[k];
            for (int64_t p = graph_.starts[v]; p < graph_.starts[v + 1]; ++p) take(out_.position[graph_.neighbours[p]]);
        }
        for (int64_t q = front.children; q < out_.fronts[s + 1].children; ++q) {
            const int64_t begin = out_.fronts[out_.children[q]].rows, end = out_.fronts[out_.children[q] + 1].rows;
            for (int64_t p = begin; p < end; ++p) take(out_.rows[p]);
        }
        std::sort(out_.rows.begin() + front.rows, out_.rows.end());
        out_.fronts[s + 1].rows = static_cast<int64_t>(out_.rows.size());
    }

    void lay_out(Front& front) {
        front.column = out_.starts[front.first];
        front.pivots = out_.starts[front.last] - front.column;
        front.segments = static_cast<int64_t>(out_.segments.size());
        int32_t scalars = 0;
        for (size_t p = front.rows; p < out_.rows.size(); ++p) {
            const int32_t k = out_.rows[p], size = out_.size_at(k);
            out_.row_offsets.push_back(scalars);
            offset_[k] = scalars;
            const bool follows = scalars > 0 && out_.rows[p - 1] == k - 1;
            if (follows) out_.segments.back().length += size;
            else out_.segments.push_back({out_.starts[k], size});
            scalars += size;
        }
        front.updates = scalars;
        front.ld_d = front.pivots <= 8 ? front.pivots : leading_dimension(front.pivots);
        front.ld_b = leading_dimension(scalars);
        front.d = out_.factor_size;
        front.b = front.d + round_up(int64_t{front.pivots} * (front.pivots + 1) / 2);
        out_.factor_size = front.b + round_up(static_cast<int64_t>(front.ld_b) * front.pivots);
        const double k = front.pivots, m = front.updates;
        front.flops = k * k * k / 3 + k * k * m + k * m * m;
        out_.flops += front.flops;
        out_.nonzeros += k * (k + 1) / 2 + k * m;
        out_.largest_pivots = std::max(out_.largest_pivots, front.pivots);
        out_.largest_updates = std::max(out_.largest_updates, front.updates);
        out_.largest_square = std::max(out_.largest_square, int64_t{front.ld_d} * front.pivots);
    }

    void plan_copies(Front& front) {
        front.copies = static_cast<int64_t>(out_.copies.size());
        for (int32_t k = front.first; k < front.last; ++k) {
            const int32_t v = out_.order[k], size = graph_.weights[v];
            const int64_t column = out_.starts[k] - front.column;
            copy(graph_.diagonal[v], column * front.ld_d + column, size, size, BlockCopy::kDiagonal, false);
            for (int64_t p = graph_.starts[v]; p < graph_.starts[v + 1]; ++p) {
                const int32_t u = graph_.neighbours[p], row = out_.position[u];
                if (row < k) continue;
                const bool below = row >= front.last;
                const int64_t target = below ? column * front.ld_b + offset_[row]
                                             : column * front.ld_d + (out_.starts[row] - front.column);
                const bool straight = pattern_.rows[graph_.blocks[p]] == u;
                copy(graph_.blocks[p], target, graph_.weights[u], size,
                     straight ? BlockCopy::kStraight : BlockCopy::kTransposed, below);
            }
        }
    }

    void copy(int64_t block, int64_t target, int32_t rows, int32_t cols, BlockCopy::Kind kind, bool below) {
        const auto narrow = []<class To>(int64_t from, To& to) {
            to = static_cast<To>(from);
            if (static_cast<int64_t>(to) != from) throw std::invalid_argument("the matrix is too large");
        };
        BlockCopy& out = out_.copies.emplace_back();
        narrow(pattern_.offsets[block], out.source);
        narrow(target, out.target);
        narrow(rows, out.rows);
        narrow(cols, out.cols);
        out.kind = kind;
        out.below = below;
    }

    void close_ranges() {
        Front& end = out_.fronts.back();
        end.parent = -1;
        end.d = out_.factor_size;
        end.rows = static_cast<int64_t>(out_.rows.size());
        end.segments = static_cast<int64_t>(out_.segments.size());
        end.copies = static_cast<int64_t>(out_.copies.size());
    }

    void plan_runs() {
        for (int32_t s = 0; s < out_.count(); ++s) {
            Front& front = out_.fronts[s];
            front.runs = front.remaining_runs = static_cast<int64_t>(out_.runs.size());
            if (front.parent == -1) continue;
            const Front& parent = out_.fronts[front.parent];
            int64_t in_parent = parent.rows;
            for (int64_t p = front.rows; p < out_.fronts[s + 1].rows; ++p) {
                const int32_t k = out_.rows[p], from = out_.row_offsets[p], size = out_.size_at(k);
                const bool pivot = k < parent.last;
                if (!pivot) {
                    while (out_.rows[in_parent] != k) ++in_parent;
                }
                const int32_t to = pivot ? out_.starts[k] - parent.column : out_.row_offsets[in_parent];
                const bool first_remaining = !pivot && (p == front.rows || out_.rows[p - 1] < parent.last);
                const bool follows = p > front.rows && !first_remaining &&
                                     out_.runs.back().to + out_.runs.back().length == to;
                if (follows) out_.runs.back().length += size;
                else out_.runs.push_back({from, to, size});
                if (pivot) front.remaining_runs = static_cast<int64_t>(out_.runs.size());
            }
        }
        out_.fronts.back().runs = out_.fronts.back().remaining_runs = static_cast<int64_t>(out_.runs.size());
    }

    const PatternView& pattern_;
    const BlockGraph& graph_;
    EliminationTree tree_;
    Supernodes supernodes_;
    std::vector<int32_t> mark_, offset_;
    Symbolic out_;
};

}  // namespace

Symbolic analyse(const PatternView& pattern, const BlockGraph& graph, std::vector<int32_t> order) {
    return Analysis(pattern, graph, std::move(order)).run();
}

}  // namespace clew::linalg
