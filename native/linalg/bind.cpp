#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <memory>

#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include "linalg/amd.hpp"
#include "linalg/etree.hpp"
#include "linalg/numeric.hpp"
#include "linalg/pattern.hpp"
#include "module.hpp"

namespace clew {

namespace {

using namespace linalg;

template <class T>
using Array = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <class T>
using Out = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T, nb::ndim<1>> hand_over(std::vector<T> values) {
    auto* owned = new std::vector<T>(std::move(values));
    nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return nb::ndarray<nb::numpy, T, nb::ndim<1>>(owned->data(), {owned->size()}, owner);
}

void require(bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
}

// A pattern's graph, from which orderings are computed and compared.
class Analysis {
public:
    Analysis(Array<int32_t> sizes, Array<int32_t> rows, Array<int32_t> cols, Array<int64_t> offsets)
        : sizes_(sizes), rows_(rows), cols_(cols), offsets_(offsets) {
        require(rows.size() == cols.size() && offsets.size() == rows.size() + 1,
                "rows, cols and offsets of a pattern differ in length");
        view_ = {static_cast<int32_t>(sizes.size()), static_cast<int64_t>(rows.size()), sizes.data(), rows.data(),
                 cols.data(), offsets.data()};
        check();
        nb::gil_scoped_release release;
        graph_ = std::make_unique<BlockGraph>(view_);
    }

    std::vector<int32_t> amd() const { return approximate_minimum_degree(*graph_); }
    const BlockGraph& graph() const { return *graph_; }
    const PatternView& view() const { return view_; }

    std::vector<int32_t> checked_order(Array<int32_t> order) const {
        std::vector<int32_t> out(order.data(), order.data() + order.size());
        std::vector<bool> seen(sizes_.size(), false);
        bool good = out.size() == seen.size();
        for (size_t k = 0; good && k < out.size(); ++k) {
            good = out[k] >= 0 && static_cast<size_t>(out[k]) < seen.size() && !seen[out[k]];
            if (good) seen[out[k]] = true;
        }
        require(good, "an elimination order is a permutation of the variables");
        return out;
    }

private:
    void check() const {
        int32_t column = -1;
        bool good = view_.offsets[0] == 0;
        for (int64_t b = 0; good && b < view_.blocks; ++b) {
            const int32_t r = view_.rows[b], c = view_.cols[b];
            good = c >= 0 && c < view_.variables && r >= c && r < view_.variables;
            if (!good) break;
            if (c == column) good = r > view_.rows[b - 1];
            else good = c == column + 1 && r == c;
            column = c;
            good = good && view_.sizes[r] > 0 &&
                   view_.offsets[b + 1] - view_.offsets[b] == int64_t{view_.sizes[r]} * view_.sizes[c];
        }
        require(good && column == view_.variables - 1,
                "the blocks of a pattern are its lower triangle with the whole diagonal, sorted by column, then row");
    }

    Array<int32_t> sizes_, rows_, cols_;
    Array<int64_t> offsets_;
    PatternView view_;
    std::unique_ptr<BlockGraph> graph_;
};

std::vector<int32_t> checked_variables(const Symbolic& symbolic, Array<int64_t> variables) {
    std::vector<int32_t> out;
    out.reserve(variables.size());
    for (size_t k = 0; k < variables.size(); ++k) {
        require(variables.data()[k] >= 0 && variables.data()[k] < symbolic.variables, "a variable does not exist");
        out.push_back(static_cast<int32_t>(variables.data()[k]));
    }
    return out;
}

// Sorted requests for the blocks of pairs, and where in the output each begins; a pair outside the factor's pattern
// ends the list and its index is returned, otherwise -1.
int64_t request_blocks(const Numeric& numeric, Array<int64_t> i, Array<int64_t> j, std::vector<InverseBlock>& wanted) {
    const Symbolic& sym = numeric.symbolic();
    const std::vector<int32_t> first = checked_variables(sym, i), second = checked_variables(sym, j);
    int64_t target = 0;
    for (size_t p = 0; p < first.size(); ++p) {
        const int32_t a = sym.position[first[p]], b = sym.position[second[p]];
        if (!numeric.stores(std::max(a, b), std::min(a, b))) return static_cast<int64_t>(p);
        wanted.push_back({std::max(a, b), std::min(a, b), a < b, target});
        target += int64_t{sym.size_at(a)} * sym.size_at(b);
    }
    std::stable_sort(wanted.begin(), wanted.end(),
                     [](const InverseBlock& a, const InverseBlock& b) { return a.col < b.col; });
    return -1;
}

void bind_pattern(nb::module_ m) {
    m.def("blocks_of_pairs", [](int32_t variables, Array<int64_t> i, Array<int64_t> j) {
        require(i.size() == j.size(), "pairs differ in length");
        BlockList list;
        {
            nb::gil_scoped_release release;
            list = blocks_of_pairs(variables, i.data(), j.data(), static_cast<int64_t>(i.size()));
        }
        return nb::make_tuple(hand_over(std::move(list.rows)), hand_over(std::move(list.cols)));
    });
    m.def("find_blocks", [](Array<int64_t> column_starts, Array<int32_t> rows, Array<int64_t> i, Array<int64_t> j) {
        require(i.size() == j.size(), "pairs differ in length");
        std::vector<int64_t> found(i.size());
        {
            nb::gil_scoped_release release;
            find_blocks(column_starts.data(), rows.data(), i.data(), j.data(), static_cast<int64_t>(i.size()),
                        found.data());
        }
        return hand_over(std::move(found));
    });
    m.def("diagonal", [](Array<int32_t> sizes, Array<int64_t> column_starts, Array<int64_t> offsets,
                         Array<double> values, Out<double> out) {
        bool good = column_starts.size() == sizes.size() + 1;
        int64_t dim = 0;
        for (size_t v = 0; good && v < sizes.size(); ++v) {
            const int64_t block = column_starts.data()[v], size = sizes.data()[v];
            good = block >= 0 && block < static_cast<int64_t>(offsets.size()) && size >= 1 &&
                   offsets.data()[block] >= 0 &&
                   offsets.data()[block] + size * size <= static_cast<int64_t>(values.size());
            dim += size;
        }
        require(good && dim == static_cast<int64_t>(out.size()), "values or output do not fit the pattern");
        nb::gil_scoped_release release;
        double* to = out.data();
        for (size_t v = 0; v < sizes.size(); ++v) {
            const int64_t size = sizes.data()[v];
            const double* from = values.data() + offsets.data()[column_starts.data()[v]];
            for (int64_t k = 0; k < size; ++k) *to++ = from[k * (size + 1)];
        }
    });
}

void bind_analysis(nb::module_ m) {
    nb::class_<Analysis>(m, "Analysis")
        .def(nb::init<Array<int32_t>, Array<int32_t>, Array<int32_t>, Array<int64_t>>())
        .def("amd", [](const Analysis& a) {
            std::vector<int32_t> order;
            {
                nb::gil_scoped_release release;
                order = a.amd();
            }
            return hand_over(std::move(order));
        })
        .def("adjacency", [](const Analysis& a) {
            return nb::make_tuple(hand_over(a.graph().starts), hand_over(a.graph().neighbours));
        })
        .def("flops", [](const Analysis& a, Array<int32_t> order) {
            std::vector<int32_t> checked = a.checked_order(order);
            nb::gil_scoped_release release;
            return elimination_tree(a.graph(), std::move(checked)).flops;
        });
    nb::class_<Symbolic>(m, "Symbolic")
        .def("__init__", [](Symbolic* self, const Analysis& a, Array<int32_t> order) {
            std::vector<int32_t> checked = a.checked_order(order);
            nb::gil_scoped_release release;
            new (self) Symbolic(linalg::analyse(a.view(), a.graph(), std::move(checked)));
        })
        .def("order", [](const Symbolic& s) { return hand_over(std::vector<int32_t>(s.order)); })
        .def_prop_ro("fronts", &Symbolic::count)
        .def_ro("flops", &Symbolic::flops)
        .def_ro("nonzeros", &Symbolic::nonzeros)
        .def_prop_ro("factor_bytes", [](const Symbolic& s) { return s.factor_size * 8; })
        .def("bytes", [](const Symbolic& s, int threads, bool keep_updates) {
            require(threads >= 1, "threads must be positive");
            return make_schedule(s, threads, keep_updates ? Updates::kKept : Updates::kTransient).storage_size * 8;
        });
}

void bind_numeric(nb::module_ m) {
    nb::class_<Numeric>(m, "Numeric")
        .def("__init__", [](Numeric* self, const Symbolic& s, int threads, bool keep_updates) {
            require(threads >= 1, "threads must be positive");
            new (self) Numeric(s, threads, keep_updates);
        }, nb::keep_alive<1, 2>())
        .def("factorize", [](Numeric& n, Array<double> values, std::optional<Array<double>> damping,
                             std::optional<Array<int64_t>> changed) {
            const Symbolic& sym = n.symbolic();
            require(static_cast<int64_t>(values.size()) == sym.values_size, "values do not fit the pattern");
            require(!damping || static_cast<int64_t>(damping->size()) == sym.dim, "damping does not fit the pattern");
            std::vector<int32_t> variables;
            if (changed) variables = checked_variables(sym, *changed);
            nb::gil_scoped_release release;
            n.factorize(values.data(), damping ? damping->data() : nullptr, changed ? &variables : nullptr);
        }, nb::arg("values"), nb::arg("damping").none(), nb::arg("changed").none())
        .def_prop_ro("status", [](const Numeric& n) { return static_cast<int>(n.status()); })
        .def_prop_ro("failed_variable", &Numeric::failed_variable)
        .def_prop_ro("weakest_ratio", &Numeric::weakest_ratio)
        .def_prop_ro("weakest_variable", &Numeric::weakest_variable)
        .def_prop_ro("keeps_updates", &Numeric::keeps_updates)
        .def("solve", [](const Numeric& n, Out<double> x) {
            require(static_cast<int64_t>(x.size()) == n.symbolic().dim, "the right-hand side does not fit the pattern");
            nb::gil_scoped_release release;
            n.solve(x.data());
        })
        .def("solve_many", [](const Numeric& n, nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> x) {
            require(static_cast<int64_t>(x.shape(0)) == n.symbolic().dim,
                    "the right-hand side does not fit the pattern");
            nb::gil_scoped_release release;
            n.solve_many(x.data(), static_cast<int32_t>(x.shape(1)));
        })
        .def("log_determinant", [](const Numeric& n) {
            nb::gil_scoped_release release;
            return n.log_determinant();
        })
        .def("inverse_blocks", [](Numeric& n, Array<int64_t> i, Array<int64_t> j, Out<double> out) {
            require(i.size() == j.size(), "pairs differ in length");
            std::vector<InverseBlock> wanted;
            const int64_t missing = request_blocks(n, i, j, wanted);
            if (missing >= 0) return missing;
            int64_t size = 0;
            for (const InverseBlock& w : wanted) {
                size += int64_t{n.symbolic().size_at(w.row)} * n.symbolic().size_at(w.col);
            }
            require(static_cast<int64_t>(out.size()) == size, "the output does not fit the pairs");
            nb::gil_scoped_release release;
            n.inverse_blocks(wanted, out.data());
            return missing;
        })
        .def("joint_covariance", [](const Numeric& n, Array<int64_t> variables, Out<double> out) {
            const std::vector<int32_t> chosen = checked_variables(n.symbolic(), variables);
            int64_t d = 0;
            for (int32_t v : chosen) d += n.symbolic().size_at(n.symbolic().position[v]);
            require(static_cast<int64_t>(out.size()) == d * d, "the output does not fit the variables");
            nb::gil_scoped_release release;
            n.joint_covariance(chosen, out.data());
        });
}

}  // namespace

void bind_linalg(nb::module_ m) {
    m.def("release_memory", [] {
#if defined(__GLIBC__)
        nb::gil_scoped_release release;
        malloc_trim(0);
#endif
    }, "Give what the allocator keeps of freed memory back to the system (glibc; elsewhere nothing is done).");
    bind_pattern(m);
    bind_analysis(m);
    bind_numeric(m);
}

}  // namespace clew
