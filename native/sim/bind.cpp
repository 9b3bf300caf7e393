#include <cmath>
#include <stdexcept>

#include "module.hpp"
#include "sim/raycast.hpp"

namespace clew {

namespace {

template <typename Shape>
using In = nb::ndarray<const double, Shape, nb::c_contig, nb::device::cpu>;

void require_finite(const double* values, std::size_t count, const char* message) {
    for (std::size_t i = 0; i < count; ++i) {
        if (!std::isfinite(values[i])) throw std::invalid_argument(message);
    }
}

void cast_rays(In<nb::shape<-1, 2, 2>> segments, In<nb::shape<-1, 3>> poses, In<nb::shape<-1>> angles, double reach,
               nb::ndarray<double, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu> ranges) {
    if (ranges.shape(0) != poses.shape(0) || ranges.shape(1) != angles.shape(0)) {
        throw std::invalid_argument("ranges must have one row a pose and one column an angle");
    }
    if (!(reach >= 0.0)) throw std::invalid_argument("reach must not be negative");
    nb::gil_scoped_release release;
    require_finite(segments.data(), segments.size(), "segments must be finite");
    require_finite(poses.data(), poses.size(), "poses must be finite");
    require_finite(angles.data(), angles.size(), "angles must be finite");
    const sim::SegmentGrid grid(segments.data(), segments.shape(0));
    sim::cast_scans(grid, poses.data(), poses.shape(0), angles.data(), angles.shape(0), reach, ranges.data());
}

}  // namespace

void bind_sim(nb::module_ m) {
    m.def("cast_rays", &cast_rays, nb::arg("segments"), nb::arg("poses"), nb::arg("angles"), nb::arg("reach"),
          nb::arg("ranges"), "Fill `ranges` with distances to the nearest segment; infinity beyond `reach`.");
}

}  // namespace clew
