#include <algorithm>
#include <cmath>
#include <vector>

#include "door.hpp"
#include "index.hpp"
#include "returns.hpp"

namespace clew::scan {

namespace {

// A cloud of points as arrays of one length.
CloudView cloud_of(const Rows2& points, const Rows2& normals, const Vector<double>& along, const Vector<double>& weights) {
    const std::size_t n = points.shape(0);
    require(normals.shape(0) == n && along.shape(0) == n && weights.shape(0) == n, "a cloud: arrays differ in length");
    require_finite(points, "a cloud: points must be finite");
    return {points.data(), normals.data(), along.data(), weights.data(), n};
}

nb::tuple merge_surfels_(const Rows2& points, const Rows2& normals, const Vector<double>& along,
                         const Vector<double>& weights, double voxel) {
    const CloudView cloud = cloud_of(points, normals, along, weights);
    require(voxel > 0, "merge_surfels: voxel must be positive");
    require(std::all_of(weights.data(), weights.data() + cloud.n, [](double w) { return w > 0; }),
            "merge_surfels: weights must be positive");
    Surfels out;
    {
        nb::gil_scoped_release release;
        out = merge_surfels(cloud.points, cloud.normals, cloud.along, cloud.weights, cloud.n, voxel);
    }
    const std::size_t m = out.along.size();
    return nb::make_tuple(own(std::move(out.points), {m, 2}), own(std::move(out.normals), {m, 2}), own(std::move(out.along), {m}));
}

nb::tuple deskew_(const Vector<double>& ranges, const Vector<double>& angles, const Vector<double>& delays,
                  const Vector<double>& velocity, const Vector<double>& T_robot_sensor) {
    const std::size_t n = ranges.shape(0);
    require(angles.shape(0) == n && delays.shape(0) == n, "deskew: arrays differ in length");
    const Pose moving = pose_of(velocity, "deskew: velocity must be (3,)"), at = pose_of(T_robot_sensor, "deskew: T_robot_sensor must be (3,)");
    std::vector<double> still(n), bearings(n);
    {
        nb::gil_scoped_release release;
        deskew(ranges.data(), angles.data(), delays.data(), n, moving, at, still.data(), bearings.data());
    }
    return nb::make_tuple(own(std::move(still), {n}), own(std::move(bearings), {n}));
}

nb::tuple tuple_of(Cloud&& cloud) {
    const std::size_t m = cloud.along.size();
    return nb::make_tuple(own(std::move(cloud.points), {m, 2}), own(std::move(cloud.normals), {m, 2}),
                          own(std::move(cloud.along), {m}), own(std::move(cloud.weights), {m}));
}

nb::tuple extract_returns_(const Vector<double>& ranges, const Vector<double>& angles, const Vector<double>& T_robot_sensor,
                           double nearest, double farthest, std::int32_t window, double radius, double gap_base,
                           double gap_per_metre, double blob, double weight_per_metre) {
    require(angles.shape(0) == ranges.shape(0), "extract_returns: ranges and angles differ in length");
    require_finite(angles, "extract_returns: angles must be finite");
    require(std::isfinite(farthest), "extract_returns: the farthest range must be finite");
    require(window >= 1 && radius > 0, "extract_returns: window and radius must be positive");
    const Pose at = pose_of(T_robot_sensor, "extract_returns: T_robot_sensor must be (3,)");
    std::vector<std::int32_t> beams;
    Cloud cloud;
    {
        nb::gil_scoped_release release;
        cloud = extract_returns(ranges.data(), angles.data(), ranges.shape(0), at,
                                {nearest, farthest, {window, radius, gap_base, gap_per_metre}, blob, weight_per_metre}, beams);
    }
    const std::size_t m = beams.size();
    return nb::make_tuple(tuple_of(std::move(cloud)), own(std::move(beams), {m}));
}

nb::tuple between_returns_(const Rows2& points, const Rows2& normals, const Vector<double>& along, const Vector<double>& weights,
                           double step, double gap_base, double gap_per_metre, double flat, double weight) {
    const CloudView view = cloud_of(points, normals, along, weights);
    require(step > 1e-6, "between_returns: step must be positive");
    Cloud cloud;
    {
        nb::gil_scoped_release release;
        cloud = between_returns(view, {step, gap_base, gap_per_metre, flat, weight});
    }
    return tuple_of(std::move(cloud));
}

}  // namespace

void bind_clouds(nb::module_& m) {
    m.def("merge_surfels", &merge_surfels_);
    m.def("deskew", &deskew_);
    m.def("extract_returns", &extract_returns_);
    m.def("between_returns", &between_returns_);
}

}  // namespace clew::scan
