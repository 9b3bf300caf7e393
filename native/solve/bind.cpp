#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "module.hpp"
#include "solve/block.hpp"
#include "solve/nearest_rotation.hpp"
#include "solve/tree.hpp"

namespace clew {

namespace {

using solve::Block;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Cube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using OutputMatrix = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Plan = nb::ndarray<const int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void require(bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
}

// Fills `block` and checks that everything it points to is as large as the kernels believe.
Block checked(const std::vector<int>& dims, const Cube& information, const Rows& gradient, const Plan& plan, int robust,
              double scale, const std::optional<Output>& hessian, const std::optional<Output>& gradient_values) {
    const std::size_t arity = dims.size();
    const std::size_t pairs = arity * (arity + 1) / 2;
    Block block;
    block.count = static_cast<int64_t>(information.shape(0));
    require(information.shape(1) == information.shape(2), "information must be (M, d, d)");
    require(gradient.shape(0) == information.shape(0) && gradient.shape(1) == arity, "gradient must be (M, arity)");
    require(plan.shape(0) == information.shape(0) && plan.shape(1) == pairs, "plan must be (M, pairs)");
    require(robust >= 0 && robust <= static_cast<int>(solve::Robust::dcs), "unknown robust kernel");
    require(scale > 0, "the robust kernel's scale must be positive");
    require(hessian.has_value() == gradient_values.has_value(), "give both Hessian and gradient or neither");
    block.information = information.data();
    block.gradient = gradient.data();
    block.plan = plan.data();
    block.robust = static_cast<solve::Robust>(robust);
    block.scale = scale;
    if (hessian) {
        block.hessian_values = hessian->data();
        block.gradient_values = gradient_values->data();
        const int64_t values = static_cast<int64_t>(hessian->shape(0));
        const int64_t scalars = static_cast<int64_t>(gradient_values->shape(0));
        bool good = true;
        for (int64_t m = 0; m < block.count; ++m) {
            const int64_t* targets = block.plan + m * static_cast<int64_t>(pairs);
            for (std::size_t p = 0; p < arity; ++p) {
                const int32_t offset = block.gradient[m * static_cast<int64_t>(arity) + static_cast<int64_t>(p)];
                good &= offset >= -1 && offset + (offset < 0 ? 0 : dims[p]) <= scalars;
                good &= (targets[p * (p + 1) / 2 + p] < 0) == (offset < 0);
                for (std::size_t q = 0; q <= p; ++q) {
                    const int64_t target = targets[p * (p + 1) / 2 + q];
                    good &= target >= -1 && (target < 0 || (target >> 2) + dims[p] * dims[q] <= values);
                }
            }
        }
        require(good, "gradient or plan point outside of the system");
    }
    return block;
}

struct Kind {
    int residual_dim, first_dim, second_dim, first_storage, second_storage, measurement;
    double (*function)(const Block&, const double*, const double*, const double*);
};

double between_se2(const Block& b, const double* x, const double* y, const double*) {
    return CLEW_DISPATCH(between_se2)(b, x, y);
}
double between_se3(const Block& b, const double* x, const double* y, const double*) {
    return CLEW_DISPATCH(between_se3)(b, x, y);
}
double point_observation_2d(const Block& b, const double* x, const double* y, const double* sensor) {
    return CLEW_DISPATCH(point_observation_2d)(b, x, y, sensor);
}
double point_observation_3d(const Block& b, const double* x, const double* y, const double* sensor) {
    return CLEW_DISPATCH(point_observation_3d)(b, x, y, sensor);
}
double range_bearing_2d(const Block& b, const double* x, const double* y, const double* sensor) {
    return CLEW_DISPATCH(range_bearing_2d)(b, x, y, sensor);
}

Kind kind_of(const std::string& name) {
    if (name == "between_se2") return {3, 3, 3, 3, 3, 3, between_se2};
    if (name == "between_se3") return {6, 6, 6, 7, 7, 7, between_se3};
    if (name == "point_observation_2d") return {2, 3, 2, 3, 2, 2, point_observation_2d};
    if (name == "point_observation_3d") return {3, 6, 3, 7, 3, 3, point_observation_3d};
    if (name == "range_bearing_2d") return {2, 3, 2, 3, 2, 2, range_bearing_2d};
    throw std::invalid_argument("no kernel is named " + name);
}

double linearise(const std::string& name, Matrix first, Matrix second, std::optional<Vector> sensor, Rows rows,
                 Matrix measurement, Cube information, Rows gradient, Plan plan, int robust, double scale,
                 std::optional<Output> hessian, std::optional<Output> gradient_values) {
    const Kind kind = kind_of(name);
    Block block = checked({kind.first_dim, kind.second_dim}, information, gradient, plan, robust, scale, hessian,
                          gradient_values);
    const std::size_t count = information.shape(0);
    require(static_cast<int>(information.shape(1)) == kind.residual_dim, "information has the wrong size");
    require(static_cast<int>(first.shape(1)) == kind.first_storage, "first values have the wrong width");
    require(static_cast<int>(second.shape(1)) == kind.second_storage, "second values have the wrong width");
    require(measurement.shape(0) == count && static_cast<int>(measurement.shape(1)) == kind.measurement,
            "measurement has the wrong shape");
    require(!sensor || static_cast<int>(sensor->shape(0)) == kind.first_storage, "sensor pose has the wrong length");
    require(rows.shape(0) == count && rows.shape(1) == 2, "rows must be (M, 2)");
    bool good = true;
    for (std::size_t m = 0; m < count; ++m) {
        good &= rows(m, 0) >= 0 && rows(m, 0) < static_cast<int64_t>(first.shape(0));
        good &= rows(m, 1) >= 0 && rows(m, 1) < static_cast<int64_t>(second.shape(0));
    }
    require(good, "rows point outside of the values");
    block.rows = rows.data();
    block.measurement = measurement.data();
    const double* sensor_pose = sensor ? sensor->data() : nullptr;
    nb::gil_scoped_release release;
    return kind.function(block, first.data(), second.data(), sensor_pose);
}

double accumulate(Matrix residual, const std::vector<Cube>& jacobians, Cube information, Rows gradient, Plan plan,
                  int robust, double scale, std::optional<Output> hessian, std::optional<Output> gradient_values) {
    const std::size_t count = information.shape(0);
    const int residual_dim = static_cast<int>(information.shape(1));
    std::vector<int> dims;
    std::vector<const double*> pointers;
    for (const Cube& jacobian : jacobians) {
        require(jacobian.shape(0) == count && static_cast<int>(jacobian.shape(1)) == residual_dim,
                "a Jacobian must be (M, d, dim)");
        dims.push_back(static_cast<int>(jacobian.shape(2)));
        pointers.push_back(jacobian.data());
    }
    require(residual.shape(0) == count && static_cast<int>(residual.shape(1)) == residual_dim,
            "residual must be (M, d)");
    const Block block = checked(dims, information, gradient, plan, robust, scale, hessian, gradient_values);
    nb::gil_scoped_release release;
    return CLEW_DISPATCH(accumulate)(block, static_cast<int>(dims.size()), residual_dim, dims.data(), residual.data(),
                                     pointers.data());
}

void retract(Matrix values, Offsets offsets, Vector delta, OutputMatrix out) {
    const std::size_t count = values.shape(0), storage = values.shape(1);
    require(storage == 3 || storage == 7, "only SE2 (3) and SE3 (7) are retracted here");
    require(out.shape(0) == count && out.shape(1) == storage, "out must have the shape of values");
    require(offsets.shape(0) == count, "offsets must be (N,)");
    const int64_t dim = storage == 3 ? 3 : 6;
    bool good = true;
    for (std::size_t n = 0; n < count; ++n)
        good &= offsets(n) >= -1 && (offsets(n) < 0 || offsets(n) + dim <= static_cast<int64_t>(delta.shape(0)));
    require(good, "offsets point outside of delta");
    nb::gil_scoped_release release;
    const auto function = storage == 3 ? CLEW_DISPATCH(retract_se2) : CLEW_DISPATCH(retract_se3);
    function(static_cast<int64_t>(count), values.data(), offsets.data(), delta.data(), out.data());
}

template <class T>
nb::object array(const std::vector<T>& values) {
    T* data = new T[values.size() ? values.size() : 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(data, {values.size()}, owner));
}

nb::tuple spanning_forest(int64_t node_count, Indices i, Indices j, Indices seeds) {
    require(node_count >= 0, "the number of nodes is negative");
    require(i.shape(0) == j.shape(0), "edges need as many first as second nodes");
    bool good = true;
    for (const Indices* nodes : {&i, &j, &seeds})
        for (std::size_t k = 0; k < nodes->shape(0); ++k) good &= (*nodes)(k) >= 0 && (*nodes)(k) < node_count;
    require(good, "an edge or seed names a node that does not exist");
    solve::Forest forest;
    {
        nb::gil_scoped_release release;
        forest = solve::breadth_first(node_count, static_cast<int64_t>(i.shape(0)), i.data(), j.data(),
                                      static_cast<int64_t>(seeds.shape(0)), seeds.data());
    }
    return nb::make_tuple(array(forest.node), array(forest.parent), array(forest.edge), array(forest.forward),
                          array(forest.component));
}

void compose_tree(Indices node, Indices parent, Indices edge, Flags forward, Matrix measurement, OutputMatrix values) {
    const std::size_t count = node.shape(0), storage = values.shape(1);
    require(storage == 3 || storage == 7, "only SE2 (3) and SE3 (7) are composed here");
    require(measurement.shape(1) == storage, "measurement and values must be of one kind");
    require(parent.shape(0) == count && edge.shape(0) == count && forward.shape(0) == count,
            "the arrays of a tree must have one length");
    const int64_t nodes = static_cast<int64_t>(values.shape(0)), edges = static_cast<int64_t>(measurement.shape(0));
    bool good = true;
    for (std::size_t n = 0; n < count; ++n) {
        good &= node(n) >= 0 && node(n) < nodes && parent(n) < nodes;
        good &= parent(n) < 0 || (edge(n) >= 0 && edge(n) < edges);
    }
    require(good, "the tree names a node or edge that does not exist");
    nb::gil_scoped_release release;
    const auto function = storage == 3 ? CLEW_DISPATCH(compose_tree_se2) : CLEW_DISPATCH(compose_tree_se3);
    function(static_cast<int64_t>(count), node.data(), parent.data(), edge.data(), forward.data(), measurement.data(),
             values.data());
}

void nearest_rotations(Cube matrices, OutputMatrix out) {
    require(matrices.shape(1) == 3 && matrices.shape(2) == 3, "matrices must be (N, 3, 3)");
    require(out.shape(0) == matrices.shape(0) && out.shape(1) == 4, "out must be (N, 4)");
    nb::gil_scoped_release release;
    solve::nearest_rotations(static_cast<int64_t>(matrices.shape(0)), matrices.data(), out.data());
}

}  // namespace

void bind_solve(nb::module_ m) {
    using namespace nb::literals;
    m.def("linearise", &linearise, "kind"_a, "first"_a, "second"_a, "sensor"_a.none(), "rows"_a, "measurement"_a,
          "information"_a, "gradient"_a, "plan"_a, "robust"_a, "scale"_a, "hessian"_a.none(),
          "gradient_values"_a.none());
    m.def("accumulate", &accumulate, "residual"_a, "jacobians"_a, "information"_a, "gradient"_a, "plan"_a, "robust"_a,
          "scale"_a, "hessian"_a.none(), "gradient_values"_a.none());
    m.def("retract", &retract, "values"_a, "offsets"_a, "delta"_a, "out"_a);
    m.def("nearest_rotations", &nearest_rotations, "matrices"_a, "out"_a);
    m.def("spanning_forest", &spanning_forest, "node_count"_a, "i"_a, "j"_a, "seeds"_a);
    m.def("compose_tree", &compose_tree, "node"_a, "parent"_a, "edge"_a, "forward"_a, "measurement"_a, "values"_a);
}

}  // namespace clew
