#include "linalg/etree.hpp"

#include <cstddef>

namespace clew::linalg {

namespace {

std::vector<int32_t> invert(const std::vector<int32_t>& order) {
    std::vector<int32_t> position(order.size());
    for (std::size_t k = 0; k < order.size(); ++k) position[order[k]] = static_cast<int32_t>(k);
    return position;
}

// J. W. H. Liu, "The role of elimination trees in sparse factorization", SIAM J. Matrix Anal. Appl. 11 (1990).
std::vector<int32_t> parents(const BlockGraph& graph, const std::vector<int32_t>& order,
                             const std::vector<int32_t>& position) {
    const auto n = static_cast<int32_t>(order.size());
    std::vector<int32_t> parent(n, -1), ancestor(n, -1);
    for (int32_t k = 0; k < n; ++k) {
        const int32_t v = order[k];
        for (int64_t p = graph.starts[v]; p < graph.starts[v + 1]; ++p) {
            int32_t i = position[graph.neighbours[p]];
            while (i != -1 && i < k) {
                const int32_t up = ancestor[i];
                ancestor[i] = k;
                if (up == -1) parent[i] = k;
                i = up;
            }
        }
    }
    return parent;
}

int32_t find_root(std::vector<int32_t>& ancestor, int32_t v) {
    int32_t root = v;
    while (root != ancestor[root]) root = ancestor[root];
    while (v != root) {
        const int32_t up = ancestor[v];
        ancestor[v] = root;
        v = up;
    }
    return root;
}

// Gilbert, Ng, Peyton, "An efficient algorithm to compute row and column counts for sparse Cholesky factorization",
// SIAM J. Matrix Anal. Appl. 15 (1994), with every row counted by its scalar size.
void count_columns(const BlockGraph& graph, EliminationTree& tree) {
    const auto n = static_cast<int32_t>(tree.order.size());
    std::vector<int32_t> first(n), last_first(n, -1), previous_leaf(n, -1), ancestor(n);
    for (int32_t j = 0; j < n; ++j) first[j] = ancestor[j] = j;
    for (int32_t j = 0; j < n; ++j) {  // first descendant: children come before parents
        const int32_t p = tree.parent[j];
        if (p != -1 && first[j] < first[p]) first[p] = first[j];
    }
    tree.count.assign(n, 0);
    for (int32_t j = 0; j < n; ++j) {
        const int32_t vertex = tree.order[j];
        const int64_t weight = graph.weights[vertex];
        bool row_is_empty = true;
        for (int64_t q = graph.starts[vertex]; q < graph.starts[vertex + 1]; ++q) {
            const int32_t i = tree.position[graph.neighbours[q]];
            if (i < j) {
                row_is_empty = false;
                continue;
            }
            if (first[j] <= last_first[i]) continue;  // j is no leaf of the subtree of row i
            last_first[i] = first[j];
            const int64_t row_weight = graph.weights[graph.neighbours[q]];
            tree.count[j] += row_weight;
            if (previous_leaf[i] != -1) tree.count[find_root(ancestor, previous_leaf[i])] -= row_weight;
            previous_leaf[i] = j;
        }
        if (row_is_empty) tree.count[j] += weight;
        if (tree.parent[j] != -1) {
            tree.count[tree.parent[j]] -= weight;
            ancestor[j] = tree.parent[j];
        }
    }
    for (int32_t j = 0; j < n; ++j) {
        if (tree.parent[j] != -1) tree.count[tree.parent[j]] += tree.count[j];
    }
    for (int32_t j = 0; j < n; ++j) {
        auto m = static_cast<double>(tree.count[j]);
        for (int32_t s = 0; s < graph.weights[tree.order[j]]; ++s, m -= 1) {
            tree.flops += m * m;
            tree.nonzeros += m;
        }
    }
}

}  // namespace

std::vector<int32_t> postorder(const std::vector<int32_t>& parent) {
    const auto n = static_cast<int32_t>(parent.size());
    std::vector<int32_t> child(n, -1), sibling(n, -1), order, stack;
    order.reserve(n);
    for (int32_t j = n - 1; j >= 0; --j) {
        if (parent[j] == -1) continue;
        sibling[j] = child[parent[j]];
        child[parent[j]] = j;
    }
    for (int32_t root = 0; root < n; ++root) {
        if (parent[root] != -1) continue;
        stack.push_back(root);
        while (!stack.empty()) {
            const int32_t v = stack.back();
            if (child[v] != -1) {
                stack.push_back(child[v]);
                child[v] = sibling[child[v]];
            } else {
                stack.pop_back();
                order.push_back(v);
            }
        }
    }
    return order;
}

EliminationTree elimination_tree(const BlockGraph& graph, std::vector<int32_t> order) {
    EliminationTree tree;
    std::vector<int32_t> parent = parents(graph, order, invert(order));
    const std::vector<int32_t> post = postorder(parent), place = invert(post);
    tree.order.resize(order.size());
    tree.parent.resize(order.size());
    for (std::size_t k = 0; k < order.size(); ++k) {
        tree.order[k] = order[post[k]];
        const int32_t p = parent[post[k]];
        tree.parent[k] = p == -1 ? -1 : place[p];
    }
    tree.position = invert(tree.order);
    count_columns(graph, tree);
    return tree;
}

}  // namespace clew::linalg
