#include "linalg/amd.hpp"

#include <algorithm>
#include <cmath>

namespace clew::linalg {

namespace {

constexpr int32_t kNone = -1;

// The quotient graph of a partial elimination. An uneliminated vertex (a "variable", or a supervariable: a set of
// variables with the same neighbours) lists its elements first, then its remaining neighbours. An eliminated pivot is
// an "element": the clique of the variables that it joined.
class QuotientGraph {
public:
    explicit QuotientGraph(const BlockGraph& graph);
    std::vector<int32_t> eliminate();

private:
    void set_dense_vertices_aside(const BlockGraph& graph);
    int32_t select_pivot();
    void form_element(int32_t pivot);
    void take_into_element(int32_t pivot, int64_t begin, int64_t end, bool in_place);
    void measure_overlaps(int32_t pivot);
    void update_variables(int32_t pivot);
    void update_variable(int32_t pivot, int32_t variable);
    void merge_indistinguishable(int32_t pivot);
    void finish_element(int32_t pivot);
    void reserve_list(int64_t length);

    void absorb(int32_t element) {
        stamp_[element] = 0;
        begin_[element] = kNone;
    }
    void append_members(int32_t to, int32_t from) {
        member_next_[member_last_[to]] = from;
        member_last_[to] = member_last_[from];
    }
    void insert_by_degree(int32_t v) {
        const int32_t d = degree_[v];
        next_[v] = by_degree_[d];
        last_[v] = kNone;
        if (by_degree_[d] != kNone) last_[by_degree_[d]] = v;
        by_degree_[d] = v;
        min_degree_ = std::min(min_degree_, d);
    }
    void remove_by_degree(int32_t v) {
        if (last_[v] != kNone) next_[last_[v]] = next_[v];
        else by_degree_[degree_[v]] = next_[v];
        if (next_[v] != kNone) last_[next_[v]] = last_[v];
    }

    int32_t n_;
    int32_t remaining_ = 0;             // weight not yet eliminated
    int32_t min_degree_ = 0;            // no vertex has a smaller degree
    int64_t clock_ = 1;                 // stamps at or above it were set for the current pivot
    std::vector<int32_t> lists_;        // storage of all lists
    int64_t free_ = 0;                  // first unused place in it
    std::vector<int64_t> begin_;        // start of each list; kNone once the vertex is gone
    std::vector<int32_t> length_;       // entries of each list
    std::vector<int32_t> elements_;     // how many of them are elements (variables only)
    std::vector<int32_t> weight_;       // of a supervariable; 0: gone; negative: in the current element
    std::vector<int32_t> degree_;       // upper bound of the external degree, or weight of an element's variables
    std::vector<int64_t> stamp_;        // of an element: clock + |Le \ Lp|; 0: absorbed
    std::vector<int32_t> by_degree_, next_, last_;
    std::vector<int32_t> bucket_;       // hash buckets of the variables of the current element
    std::vector<uint32_t> hash_;
    std::vector<int32_t> member_next_, member_last_;  // vertices of each supervariable or pivot
    std::vector<int32_t> pivots_, dense_;
};

QuotientGraph::QuotientGraph(const BlockGraph& graph)
    : n_(graph.vertices),
      begin_(n_), length_(n_), elements_(n_, 0), weight_(graph.weights), degree_(n_, 0), stamp_(n_, 1),
      next_(n_, kNone), last_(n_, kNone), bucket_(n_, kNone), hash_(n_, 0), member_next_(n_, kNone),
      member_last_(n_) {
    for (int32_t v = 0; v < n_; ++v) member_last_[v] = v;
    set_dense_vertices_aside(graph);
    lists_.resize(static_cast<size_t>(graph.neighbours.size() + graph.neighbours.size() / 4) + 2 * n_ + 16);
    for (int32_t v = 0; v < n_; ++v) {
        begin_[v] = free_;
        if (weight_[v] == 0) continue;
        for (int64_t p = graph.starts[v]; p < graph.starts[v + 1]; ++p) {
            const int32_t u = graph.neighbours[p];
            if (weight_[u] == 0) continue;
            lists_[free_++] = u;
            degree_[v] += weight_[u];
        }
        length_[v] = static_cast<int32_t>(free_ - begin_[v]);
        remaining_ += weight_[v];
    }
    by_degree_.assign(static_cast<size_t>(remaining_) + 1, kNone);
    min_degree_ = remaining_;
    for (int32_t v = n_ - 1; v >= 0; --v) {
        if (weight_[v] > 0) insert_by_degree(v);
    }
}

// Vertices with very many neighbours make every update slow and end up last anyway.
void QuotientGraph::set_dense_vertices_aside(const BlockGraph& graph) {
    const auto limit = static_cast<int64_t>(std::max(16.0, 10.0 * std::sqrt(static_cast<double>(n_))));
    for (int32_t v = 0; v < n_; ++v) {
        if (graph.starts[v + 1] - graph.starts[v] > limit) dense_.push_back(v);
    }
    for (int32_t v : dense_) weight_[v] = 0;
    std::stable_sort(dense_.begin(), dense_.end(), [&](int32_t a, int32_t b) {
        return graph.starts[a + 1] - graph.starts[a] < graph.starts[b + 1] - graph.starts[b];
    });
}

std::vector<int32_t> QuotientGraph::eliminate() {
    while (remaining_ > 0) {
        const int32_t pivot = select_pivot();
        form_element(pivot);
        measure_overlaps(pivot);
        update_variables(pivot);
        merge_indistinguishable(pivot);
        finish_element(pivot);
    }
    std::vector<int32_t> order;
    order.reserve(n_);
    for (int32_t pivot : pivots_) {
        for (int32_t v = pivot; v != kNone; v = member_next_[v]) order.push_back(v);
    }
    order.insert(order.end(), dense_.begin(), dense_.end());
    return order;
}

int32_t QuotientGraph::select_pivot() {
    while (by_degree_[min_degree_] == kNone) ++min_degree_;
    const int32_t pivot = by_degree_[min_degree_];
    remove_by_degree(pivot);
    pivots_.push_back(pivot);
    remaining_ -= weight_[pivot];
    return pivot;
}

// Lp = (A_p and the variables of all elements of p) without p; those elements are absorbed.
void QuotientGraph::form_element(int32_t pivot) {
    weight_[pivot] = -weight_[pivot];
    if (elements_[pivot] == 0) {
        const int64_t begin = begin_[pivot], end = begin + length_[pivot];
        degree_[pivot] = 0;
        length_[pivot] = 0;
        take_into_element(pivot, begin, end, true);
        return;
    }
    int64_t bound = length_[pivot];
    for (int64_t p = begin_[pivot]; p < begin_[pivot] + elements_[pivot]; ++p) bound += length_[lists_[p]];
    reserve_list(bound);
    const int64_t own = begin_[pivot], own_variables = own + elements_[pivot], own_end = own + length_[pivot];
    begin_[pivot] = free_;
    length_[pivot] = 0;
    degree_[pivot] = 0;
    for (int64_t p = own; p < own_variables; ++p) {
        const int32_t e = lists_[p];
        if (stamp_[e] == 0) continue;
        take_into_element(pivot, begin_[e], begin_[e] + length_[e], false);
        absorb(e);
    }
    take_into_element(pivot, own_variables, own_end, false);
    free_ = begin_[pivot] + length_[pivot];
}

void QuotientGraph::take_into_element(int32_t pivot, int64_t begin, int64_t end, bool in_place) {
    int64_t to = in_place ? begin : begin_[pivot] + length_[pivot];
    const int64_t first = to;
    for (int64_t p = begin; p < end; ++p) {
        const int32_t i = lists_[p];
        if (weight_[i] <= 0) continue;
        remove_by_degree(i);
        degree_[pivot] += weight_[i];
        weight_[i] = -weight_[i];
        lists_[to++] = i;
    }
    length_[pivot] += static_cast<int32_t>(to - first);
}

// stamp[e] - clock = |Le \ Lp| for all elements next to the variables of the new one.
void QuotientGraph::measure_overlaps(int32_t pivot) {
    for (int64_t q = begin_[pivot]; q < begin_[pivot] + length_[pivot]; ++q) {
        const int32_t i = lists_[q], w = -weight_[i];
        for (int64_t p = begin_[i]; p < begin_[i] + elements_[i]; ++p) {
            const int32_t e = lists_[p];
            if (stamp_[e] >= clock_) stamp_[e] -= w;
            else if (stamp_[e] != 0) stamp_[e] = clock_ + degree_[e] - w;
        }
    }
}

void QuotientGraph::update_variables(int32_t pivot) {
    for (int64_t q = begin_[pivot]; q < begin_[pivot] + length_[pivot]; ++q) update_variable(pivot, lists_[q]);
    clock_ += static_cast<int64_t>(by_degree_.size());
}

void QuotientGraph::update_variable(int32_t pivot, int32_t i) {
    const int64_t begin = begin_[i], elements_end = begin + elements_[i], end = begin + length_[i];
    int64_t to = begin, degree = 0;
    uint32_t hash = 0;
    for (int64_t p = begin; p < elements_end; ++p) {
        const int32_t e = lists_[p];
        if (stamp_[e] == 0) continue;
        if (stamp_[e] > clock_) {
            degree += stamp_[e] - clock_;
            lists_[to++] = e;
            hash += static_cast<uint32_t>(e);
        } else {
            absorb(e);  // all of its variables are in the new element
        }
    }
    const int64_t variables = to;
    for (int64_t p = elements_end; p < end; ++p) {
        const int32_t j = lists_[p];
        if (weight_[j] <= 0) continue;  // gone, or joined with i by the new element
        degree += weight_[j];
        lists_[to++] = j;
        hash += static_cast<uint32_t>(j);
    }
    if (to == begin) {  // no neighbours outside the new element: eliminated with the pivot at no cost
        degree_[pivot] += weight_[i];
        remaining_ += weight_[i];
        weight_[i] = 0;
        begin_[i] = kNone;
        append_members(pivot, i);
        return;
    }
    degree_[i] = static_cast<int32_t>(std::min<int64_t>(degree_[i], degree));
    // The pivot goes first; at least one place was freed by what it replaces.
    lists_[to] = lists_[variables];
    lists_[variables] = lists_[begin];
    lists_[begin] = pivot;
    elements_[i] = static_cast<int32_t>(variables - begin) + 1;
    length_[i] = static_cast<int32_t>(to - begin) + 1;
    hash %= static_cast<uint32_t>(n_);
    hash_[i] = hash;
    next_[i] = bucket_[hash];
    bucket_[hash] = i;
}

void QuotientGraph::merge_indistinguishable(int32_t pivot) {
    for (int64_t q = begin_[pivot]; q < begin_[pivot] + length_[pivot]; ++q) {
        if (weight_[lists_[q]] >= 0) continue;
        int32_t i = bucket_[hash_[lists_[q]]];
        bucket_[hash_[lists_[q]]] = kNone;
        for (; i != kNone && next_[i] != kNone; i = next_[i]) {
            for (int64_t p = begin_[i] + 1; p < begin_[i] + length_[i]; ++p) stamp_[lists_[p]] = clock_;
            int32_t previous = i;
            for (int32_t j = next_[i]; j != kNone; j = next_[j]) {
                bool same = length_[j] == length_[i] && elements_[j] == elements_[i];
                for (int64_t p = begin_[j] + 1; same && p < begin_[j] + length_[j]; ++p) {
                    same = stamp_[lists_[p]] == clock_;
                }
                if (!same) {
                    previous = j;
                    continue;
                }
                weight_[i] += weight_[j];
                weight_[j] = 0;
                begin_[j] = kNone;
                append_members(i, j);
                next_[previous] = next_[j];
            }
            ++clock_;
        }
    }
}

void QuotientGraph::finish_element(int32_t pivot) {
    const int64_t begin = begin_[pivot];
    int64_t to = begin;
    for (int64_t q = begin; q < begin + length_[pivot]; ++q) {
        const int32_t i = lists_[q];
        if (weight_[i] >= 0) continue;
        const int32_t w = -weight_[i];
        weight_[i] = w;
        degree_[i] = std::min(degree_[i] + degree_[pivot] - w, remaining_ - w);
        insert_by_degree(i);
        lists_[to++] = i;
    }
    weight_[pivot] = 0;
    length_[pivot] = static_cast<int32_t>(to - begin);
    elements_[pivot] = 0;
    if (to == begin) absorb(pivot);
}

// Makes room for a list of at most `length` entries: closes the gaps between lists, and grows if that is not enough.
void QuotientGraph::reserve_list(int64_t length) {
    if (free_ + length <= static_cast<int64_t>(lists_.size())) return;
    std::vector<int32_t> packed(lists_.size());
    int64_t to = 0;
    for (int32_t v = 0; v < n_; ++v) {
        if (begin_[v] == kNone) continue;
        std::copy_n(lists_.begin() + begin_[v], length_[v], packed.begin() + to);
        begin_[v] = to;
        to += length_[v];
    }
    lists_.swap(packed);
    free_ = to;
    if (free_ + length > static_cast<int64_t>(lists_.size())) lists_.resize(static_cast<size_t>(free_ + length));
}

}  // namespace

std::vector<int32_t> approximate_minimum_degree(const BlockGraph& graph) {
    if (graph.vertices == 0) return {};
    return QuotientGraph(graph).eliminate();
}

}  // namespace clew::linalg
