#include "linalg/supernodes.hpp"

#include <algorithm>

namespace clew::linalg {

namespace {

// Time of one front with k pivot columns and m update rows, nanoseconds on one core (fitted to measurements: a fixed
// price, memory traffic of the panel and of the update matrix, arithmetic). Only ratios matter.
double front_time(double k, double m) {
    const double flops = k * k * k / 3 + k * k * m + k * m * m;
    return 60.0 + 0.6 * k * (k / 2 + m) + 0.4 * m * m + 0.05 * flops;
}

// Merges a child into its parent when the merged front, with the zeros that it stores, costs less time than the two.
class Amalgamation {
public:
    Amalgamation(const BlockGraph& graph, const EliminationTree& tree) : tree_(tree) {
        const size_t n = tree.order.size();
        pivots_.resize(n);
        updates_.resize(n);
        merged_into_.assign(n, -1);
        child_.assign(n, -1);
        sibling_.assign(n, -1);
        for (size_t j = 0; j < n; ++j) {
            pivots_[j] = graph.weights[tree.order[j]];
            updates_[j] = static_cast<double>(tree.count[j]) - pivots_[j];
        }
    }

    // After this, `merged_into` leads from each position to a later one of its supernode, or is -1 for the last.
    void run() {
        const auto n = static_cast<int32_t>(pivots_.size());
        std::vector<int32_t> candidates;
        for (int32_t p = 0; p < n; ++p) {
            candidates.clear();
            for (int32_t c = child_[p]; c != -1; c = sibling_[c]) candidates.push_back(c);
            std::sort(candidates.begin(), candidates.end(), [&](int32_t a, int32_t b) {
                const double rows_a = pivots_[a] + updates_[a], rows_b = pivots_[b] + updates_[b];
                return rows_a != rows_b ? rows_a > rows_b : a < b;
            });
            child_[p] = -1;
            for (int32_t c : candidates) {
                if (!try_merge(c, p)) adopt(p, c);
            }
            if (tree_.parent[p] != -1) adopt(tree_.parent[p], p);
        }
    }

    int32_t merged_into(int32_t j) const { return merged_into_[j]; }
    int32_t first_child(int32_t j) const { return child_[j]; }
    int32_t sibling(int32_t j) const { return sibling_[j]; }
    double updates(int32_t j) const { return updates_[j]; }

private:
    void adopt(int32_t p, int32_t c) {
        sibling_[c] = child_[p];
        child_[p] = c;
    }

    bool try_merge(int32_t c, int32_t p) {
        const double apart = front_time(pivots_[c], updates_[c]) + front_time(pivots_[p], updates_[p]);
        if (front_time(pivots_[c] + pivots_[p], updates_[p]) > apart) return false;
        pivots_[p] += pivots_[c];
        merged_into_[c] = p;
        for (int32_t g = child_[c]; g != -1;) {
            const int32_t next = sibling_[g];
            adopt(p, g);
            g = next;
        }
        return true;
    }

    const EliminationTree& tree_;
    std::vector<double> pivots_, updates_;
    std::vector<int32_t> merged_into_, child_, sibling_;
};

// Scalar columns after which a supernode is cut: the pieces pass on what one large front would have held at once.
constexpr int64_t kWidest = 192;

// The same supernodes, wide ones in pieces that follow each other; children hang on the first piece.
Supernodes cut(const Supernodes& whole, const BlockGraph& graph, const EliminationTree& tree) {
    Supernodes out;
    out.members = whole.members;
    std::vector<int32_t> first(whole.parent.size());
    for (int32_t s = 0; s < whole.count(); ++s) {
        first[s] = out.count();
        int64_t width = kWidest;
        for (int32_t k = whole.member_starts[s]; k < whole.member_starts[s + 1]; ++k) {
            const int32_t weight = graph.weights[tree.order[whole.members[k]]];
            if (width + weight > kWidest) {
                width = 0;
                out.member_starts.push_back(k);
                out.parent.push_back(out.count() + 1);
            }
            width += weight;
        }
    }
    out.member_starts.push_back(static_cast<int32_t>(out.members.size()));
    for (int32_t s = 0; s < whole.count(); ++s) {
        const int32_t last = (s + 1 < whole.count() ? first[s + 1] : out.count()) - 1;
        out.parent[last] = whole.parent[s] == -1 ? -1 : first[whole.parent[s]];
    }
    return out;
}

}  // namespace

Supernodes amalgamate(const BlockGraph& graph, const EliminationTree& tree) {
    const auto n = static_cast<int32_t>(tree.order.size());
    Amalgamation merged(graph, tree);
    merged.run();

    // The child that needs the most memory beyond what it hands up goes first (Liu, "On the storage requirement in the
    // out-of-core multifrontal method for sparse factorization", ACM TOMS 12, 1986).
    std::vector<double> peak(n, 0);
    std::vector<int32_t> children, child_starts(static_cast<size_t>(n) + 1, 0);
    for (int32_t s = 0; s < n; ++s) {
        child_starts[s] = static_cast<int32_t>(children.size());
        if (merged.merged_into(s) != -1) continue;
        for (int32_t c = merged.first_child(s); c != -1; c = merged.sibling(c)) children.push_back(c);
        const auto held = [&](int32_t c) { return merged.updates(c) * merged.updates(c) / 2; };
        std::sort(children.begin() + child_starts[s], children.end(), [&](int32_t a, int32_t b) {
            const double beyond_a = peak[a] - held(a), beyond_b = peak[b] - held(b);
            return beyond_a != beyond_b ? beyond_a > beyond_b : a < b;
        });
        double below = 0;
        for (size_t q = child_starts[s]; q < children.size(); ++q) {
            peak[s] = std::max(peak[s], below + peak[children[q]]);
            below += held(children[q]);
        }
        peak[s] = std::max(peak[s], below + held(s));
    }
    child_starts[n] = static_cast<int32_t>(children.size());

    // Iterative postorder over the supernodes in that order of children.
    Supernodes out;
    std::vector<int32_t> number(n, -1), next(child_starts.begin(), child_starts.end() - 1), stack;
    for (int32_t root = 0; root < n; ++root) {
        if (merged.merged_into(root) != -1 || tree.parent[root] != -1) continue;
        stack.push_back(root);
        while (!stack.empty()) {
            const int32_t s = stack.back();
            if (next[s] < child_starts[s + 1]) {
                stack.push_back(children[next[s]++]);
                continue;
            }
            stack.pop_back();
            number[s] = out.count();
            out.parent.push_back(-1);
            for (int32_t q = child_starts[s]; q < child_starts[s + 1]; ++q) out.parent[number[children[q]]] = number[s];
        }
    }
    for (int32_t j = n - 1; j >= 0; --j) {
        if (merged.merged_into(j) != -1) number[j] = number[merged.merged_into(j)];
    }
    out.member_starts.assign(out.parent.size() + 1, 0);
    for (int32_t j = 0; j < n; ++j) ++out.member_starts[number[j] + 1];
    for (int32_t s = 0; s < out.count(); ++s) out.member_starts[s + 1] += out.member_starts[s];
    out.members.resize(n);
    std::vector<int32_t> place(out.member_starts.begin(), out.member_starts.end() - 1);
    for (int32_t j = 0; j < n; ++j) out.members[place[number[j]]++] = j;
    return cut(out, graph, tree);
}

}  // namespace clew::linalg
