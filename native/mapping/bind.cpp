#include <array>
#include <stdexcept>
#include <utility>
#include <vector>

#include "mapping/looks.hpp"
#include "mapping/raycast.hpp"
#include "mapping/visibility.hpp"
#include "module.hpp"

namespace clew {

namespace {

using CellArray = nb::ndarray<std::uint16_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using PoseArray = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using PointArray = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using IndexArray = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using ValueArray = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using MomentArray = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using FlagArray = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// The values (finite poses and endpoints) are checked by the Python door; what could reach beyond an array is checked here.
mapping::Rays checked(const PoseArray& poses, const IndexArray& offsets, const PointArray& endpoints,
                      const FlagArray& hit) {
    const auto beams = static_cast<std::int64_t>(endpoints.shape(0));
    if (hit.shape(0) != endpoints.shape(0)) throw std::invalid_argument("hit and endpoints differ in length");
    if (offsets.shape(0) != poses.shape(0) + 1) throw std::invalid_argument("offsets must be one longer than poses");
    if (offsets(0) != 0 || offsets(poses.shape(0)) != beams) {
        throw std::invalid_argument("offsets must run from 0 to the number of beams");
    }
    for (std::size_t s = 0; s < poses.shape(0); ++s) {
        if (offsets(s) > offsets(s + 1)) throw std::invalid_argument("offsets must not decrease");
    }
    return {poses.data(), offsets.data(), endpoints.data(), hit.data(), poses.shape(0)};
}

template <typename T>
nb::ndarray<nb::numpy, T, nb::ndim<1>> owned(std::vector<T>&& values) {
    auto* kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return {kept->data(), {kept->size()}, owner};
}

// Checked as above; ranges may be anything.
mapping::Looks checked(const PoseArray& poses, const IndexArray& offsets, const ValueArray& first_angle,
                       const ValueArray& increment, const ValueArray& range, const MomentArray& moment) {
    const std::size_t scans = poses.shape(0);
    if (first_angle.shape(0) != scans || increment.shape(0) != scans || moment.shape(0) != scans) {
        throw std::invalid_argument("angles, increments and moments must be as many as poses");
    }
    if (offsets.shape(0) != scans + 1) throw std::invalid_argument("offsets must be one longer than poses");
    if (offsets(0) != 0 || offsets(scans) != static_cast<std::int64_t>(range.shape(0))) {
        throw std::invalid_argument("offsets must run from 0 to the number of beams");
    }
    for (std::size_t s = 0; s < scans; ++s) {
        if (offsets(s) > offsets(s + 1)) throw std::invalid_argument("offsets must not decrease");
        if (moment(s) < 0) throw std::invalid_argument("moments must not be negative");
    }
    return {poses.data(), offsets.data(), first_angle.data(), increment.data(), range.data(), moment.data(), scans};
}

// As above, with the clear length of each beam.
mapping::Views checked(const PoseArray& poses, const IndexArray& offsets, const ValueArray& first_angle,
                       const ValueArray& increment, const ValueArray& range, const ValueArray& clear) {
    const std::size_t views = poses.shape(0);
    if (first_angle.shape(0) != views || increment.shape(0) != views) {
        throw std::invalid_argument("angles and increments must be as many as poses");
    }
    if (range.shape(0) != clear.shape(0)) throw std::invalid_argument("range and clear must be of one length");
    if (offsets.shape(0) != views + 1 || offsets(0) != 0 || offsets(views) != static_cast<std::int64_t>(range.shape(0))) {
        throw std::invalid_argument("offsets must run from 0 to the number of beams");
    }
    for (std::size_t v = 0; v < views; ++v) {
        if (offsets(v) > offsets(v + 1)) throw std::invalid_argument("offsets must not decrease");
        if (increment(v) == 0.0) throw std::invalid_argument("increments must not be zero");
    }
    return {poses.data(), offsets.data(), first_angle.data(), increment.data(), range.data(), clear.data(), views};
}

}  // namespace

void bind_mapping(nb::module_ m) {
    m.def(
        "cast_rays",
        [](CellArray cells, std::int64_t first_row, std::int64_t first_col, double resolution, PoseArray poses,
           IndexArray offsets, PointArray endpoints, FlagArray hit, double margin, std::uint16_t stamp) {
            const mapping::Rays rays = checked(poses, offsets, endpoints, hit);
            if (!(resolution > 0.0) || !(margin >= 0.0)) {
                throw std::invalid_argument("resolution must be positive and margin not negative");
            }
            const mapping::Window window{reinterpret_cast<mapping::Cell*>(cells.data()),
                                         static_cast<std::int64_t>(cells.shape(0)),
                                         static_cast<std::int64_t>(cells.shape(1)),
                                         first_row,
                                         first_col,
                                         resolution};
            nb::gil_scoped_release release;
            return mapping::cast(window, rays, margin, stamp);
        },
        nb::arg("cells").noconvert(), nb::arg("first_row"), nb::arg("first_col"), nb::arg("resolution"),
        nb::arg("T_world_sensor").noconvert(), nb::arg("offsets").noconvert(), nb::arg("endpoints").noconvert(),
        nb::arg("hit").noconvert(), nb::arg("margin"), nb::arg("stamp"));
    m.def(
        "ray_bounds",
        [](PoseArray poses, IndexArray offsets, PointArray endpoints, FlagArray hit) {
            const mapping::Rays rays = checked(poses, offsets, endpoints, hit);
            std::array<double, 4> box{};
            {
                nb::gil_scoped_release release;
                mapping::bounds(rays, box.data());
            }
            return nb::make_tuple(box[0], box[1], box[2], box[3]);
        },
        nb::arg("T_world_sensor").noconvert(), nb::arg("offsets").noconvert(), nb::arg("endpoints").noconvert(),
        nb::arg("hit").noconvert());
    m.def(
        "count_looks",
        [](PoseArray poses, IndexArray offsets, ValueArray first_angle, ValueArray increment, ValueArray range,
           MomentArray moment, double resolution, double reach, double free_range, double width, double margin,
           double sure) {
            const mapping::Looks looks = checked(poses, offsets, first_angle, increment, range, moment);
            if (!(resolution > 0.0) || !(reach >= 0.0 && reach / resolution < 1e8) || !(free_range >= 0.0) ||
                !(width >= 0.0) || !(margin >= 0.0) || !(sure >= 0.0)) {
                throw std::invalid_argument("resolution must be positive, lengths not negative, reach finite");
            }
            const std::size_t beams = range.shape(0);
            std::vector<double> clear(beams);
            std::vector<std::int32_t> hits(beams), misses(beams), changes(beams);
            std::vector<std::uint8_t> seen_last(beams), both_ways(beams);
            {
                nb::gil_scoped_release release;
                const mapping::LookOptions options{resolution, reach, free_range, width, margin, sure};
                mapping::clear_lengths(looks, options, clear.data());
                mapping::count_looks(looks, options, clear.data(),
                                     {hits.data(), misses.data(), changes.data(), seen_last.data(), both_ways.data()});
            }
            return nb::make_tuple(owned(std::move(clear)), owned(std::move(hits)), owned(std::move(misses)),
                                  owned(std::move(changes)), owned(std::move(seen_last)), owned(std::move(both_ways)));
        },
        nb::arg("T_world_sensor").noconvert(), nb::arg("offsets").noconvert(), nb::arg("first_angle").noconvert(),
        nb::arg("increment").noconvert(), nb::arg("range").noconvert(), nb::arg("moment").noconvert(),
        nb::arg("resolution"), nb::arg("reach"), nb::arg("free_range"), nb::arg("width"), nb::arg("margin"),
        nb::arg("sure"));
    m.def(
        "clear_lengths",
        [](PoseArray poses, IndexArray offsets, ValueArray first_angle, ValueArray increment, ValueArray range,
           MomentArray moment, double reach, double free_range, double width, double margin) {
            const mapping::Looks looks = checked(poses, offsets, first_angle, increment, range, moment);
            if (!(reach >= 0.0) || !(free_range >= 0.0) || !(width >= 0.0) || !(margin >= 0.0)) {
                throw std::invalid_argument("lengths must not be negative");
            }
            std::vector<double> clear(range.shape(0));
            {
                nb::gil_scoped_release release;
                mapping::clear_lengths(looks, {1.0, reach, free_range, width, margin, 0.0}, clear.data());
            }
            return owned(std::move(clear));
        },
        nb::arg("T_world_sensor").noconvert(), nb::arg("offsets").noconvert(), nb::arg("first_angle").noconvert(),
        nb::arg("increment").noconvert(), nb::arg("range").noconvert(), nb::arg("moment").noconvert(),
        nb::arg("reach"), nb::arg("free_range"), nb::arg("width"), nb::arg("margin"));
    m.def(
        "see",
        [](PoseArray poses, IndexArray offsets, ValueArray first_angle, ValueArray increment, ValueArray range,
           ValueArray clear, PointArray points, double slack) {
            const mapping::Views views = checked(poses, offsets, first_angle, increment, range, clear);
            const std::size_t count = points.shape(0);
            std::vector<std::int32_t> seen(count), through(count);
            {
                nb::gil_scoped_release release;
                mapping::see(views, points.data(), count, slack, seen.data(), through.data());
            }
            return nb::make_tuple(owned(std::move(seen)), owned(std::move(through)));
        },
        nb::arg("T_sensor_points").noconvert(), nb::arg("offsets").noconvert(), nb::arg("first_angle").noconvert(),
        nb::arg("increment").noconvert(), nb::arg("range").noconvert(), nb::arg("clear").noconvert(),
        nb::arg("points").noconvert(), nb::arg("slack"));
}

}  // namespace clew
