// What the bindings of this room share: arrays as they are taken and given, and what is refused.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <stdexcept>
#include <utility>
#include <vector>

#include "module.hpp"
#include "views.hpp"

namespace clew::scan {

template <typename T>
using Vector = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows2 = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Rows3 = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Out = nb::ndarray<nb::numpy, T>;

constexpr std::int32_t most_cells = 1 << 30;

inline void require(bool condition, const char* message) {
    if (!condition) throw std::invalid_argument(message);
}

// A kernel turns coordinates into indices of cells, which what is not finite has none of.
template <typename A>
void require_finite(const A& array, const char* message) {
    require(std::all_of(array.data(), array.data() + array.size(), [](double v) { return std::isfinite(v); }), message);
}

template <typename T>
Out<T> own(std::vector<T>&& data, std::initializer_list<std::size_t> shape) {
    auto* held = new std::vector<T>(std::move(data));
    nb::capsule owner(held, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return Out<T>(held->data(), shape, owner);
}

inline Pose pose_of(const Vector<double>& v, const char* message) {
    require(v.shape(0) == 3, message);
    return {v.data()[0], v.data()[1], v.data()[2]};
}

// Cleaning, deskewing and merging of clouds; called by bind_scan.
void bind_clouds(nb::module_& m);

}  // namespace clew::scan
