#include <algorithm>
#include <cmath>
#include <thread>
#include <vector>

#include "align.hpp"
#include "correlate.hpp"
#include "door.hpp"
#include "index.hpp"

namespace clew {

namespace {

using namespace scan;

nb::tuple sort_into_buckets_(const Rows2& points, const Rows2& normals, const Vector<double>& along, double origin_x,
                             double origin_y, double cell, std::int32_t width, std::int32_t height) {
    require(width > 0 && height > 0 && cell > 0, "sort_into_buckets: the grid is empty");
    require(width <= most_cells / height, "sort_into_buckets: the grid is too large");
    const std::size_t n = points.shape(0), cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    require(normals.shape(0) == n && along.shape(0) == n, "sort_into_buckets: arrays differ in length");
    require_finite(points, "sort_into_buckets: points must be finite");
    std::vector<std::int32_t> starts(cells + 1);
    std::vector<double> entries(entry_columns * n);
    {
        nb::gil_scoped_release release;
        sort_into_buckets(points.data(), normals.data(), along.data(), n, origin_x, origin_y, cell, width, height, starts.data(),
                          reinterpret_cast<Entry*>(entries.data()));
    }
    return nb::make_tuple(own(std::move(starts), {cells + 1}), own(std::move(entries), {n, entry_columns}));
}

Out<std::uint8_t> build_pyramid_(const Rows2& points, double sigma, std::int32_t levels, std::int32_t height,
                                 std::int32_t width, double origin_x, double origin_y, double resolution) {
    require(levels >= 1 && levels <= 12 && height > 0 && width > 0, "build_pyramid: the grid is empty");
    require(sigma > 0 && resolution > 0, "build_pyramid: sigma and resolution must be positive");
    require(width <= most_cells / height, "build_pyramid: the grid is too large");
    require_finite(points, "build_pyramid: points must be finite");
    const auto l = static_cast<std::size_t>(levels), h = static_cast<std::size_t>(height), w = static_cast<std::size_t>(width);
    std::vector<std::uint8_t> cells(l * h * w);
    {
        nb::gil_scoped_release release;
        build_pyramid(points.data(), points.shape(0), sigma,
                      {nullptr, levels, height, width, origin_x, origin_y, resolution}, cells.data());
    }
    return own(std::move(cells), {l, h, w});
}

// Vectors of three hold (x, y, theta). Returns (found, pose, score, likelihood, evaluated).
nb::tuple correlate_(const nb::ndarray<const std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>& cells,
                     double origin_x, double origin_y, double resolution, const Rows2& points,
                     const Vector<double>& centre, const Vector<double>& half, double step_theta,
                     const Vector<double>& prior_sigmas, double prior_weight, double minimum_score,
                     const Vector<double>& excluded, double exclude_distance, double exclude_angle) {
    require(cells.size() > 0 && cells.shape(0) <= 12, "correlate: the pyramid is empty");
    require_finite(points, "correlate: points must be finite");
    require(resolution > 0 && step_theta > 0, "correlate: resolution and step_theta must be positive");
    const Pose middle = pose_of(centre, "correlate: centre must be (3,)"), window = pose_of(half, "correlate: half must be (3,)");
    const Pose prior = pose_of(prior_sigmas, "correlate: prior_sigmas must be (3,)");
    require(std::isfinite(middle.x) && std::isfinite(middle.y) && std::isfinite(middle.theta), "correlate: centre is not finite");
    require(window.x >= 0 && window.y >= 0 && window.theta >= 0 && std::isfinite(window.x + window.y + window.theta),
            "correlate: the window must be finite and not negative");
    require(window.x / resolution < 1e5 && window.y / resolution < 1e5 && window.theta / step_theta < 1e5,
            "correlate: the window is too large");
    require(prior.x > 0 && prior.y > 0 && prior.theta > 0, "correlate: prior_sigmas must be positive");
    const bool exclude = excluded.shape(0) > 0;
    const PyramidView pyramid{cells.data(), static_cast<std::int32_t>(cells.shape(0)), static_cast<std::int32_t>(cells.shape(1)),
                              static_cast<std::int32_t>(cells.shape(2)), origin_x, origin_y, resolution};
    const SearchOptions options{middle, window.x, window.y, window.theta, step_theta, prior.x, prior.y, prior.theta,
                                prior_weight, minimum_score, exclude,
                                exclude ? pose_of(excluded, "correlate: excluded must be (3,) or empty") : Pose{0, 0, 0}, exclude_distance, exclude_angle};
    SearchResult result;
    {
        nb::gil_scoped_release release;
        result = correlate(pyramid, points.data(), points.shape(0), options);
    }
    return nb::make_tuple(result.found, own(std::vector<double>{result.pose.x, result.pose.y, result.pose.theta}, {3}),
                          result.score, result.likelihood, result.evaluated);
}

// The buckets of one cloud hold its own points only.
void require_index(const std::int64_t* entries, const std::int64_t* starts_of, const std::int32_t* shape, double cell,
                   const std::int32_t* starts) {
    const std::int64_t n = entries[1] - entries[0];
    require(n >= 0 && cell > 0 && shape[0] > 0 && shape[1] > 0 &&
                starts_of[1] - starts_of[0] == static_cast<std::int64_t>(shape[0]) * shape[1] + 1,
            "align: the buckets do not fit their cloud");
    const std::int32_t *first = starts + starts_of[0], *last = starts + starts_of[1];
    require(*first == 0 && last[-1] == n && std::is_sorted(first, last), "align: the buckets do not fit their cloud");
}

// Clouds of points one after the other, with offsets (C + 1,); the indices of the targets likewise.
nb::tuple align_(const nb::ndarray<const double, nb::shape<-1, entry_columns>, nb::c_contig, nb::device::cpu>& entries,
                 const Vector<std::int64_t>& target_offsets, const Vector<std::int32_t>& starts,
                 const Vector<std::int64_t>& starts_offsets, const Rows2& origins,
                 const nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>& shapes,
                 const Vector<double>& cells,
                 const Rows2& points, const Rows2& normals, const Vector<double>& weights,
                 const Vector<std::int64_t>& offsets,
                 const nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>& pairs,
                 const Rows3& T_start, const Rows3& T_prior,
                 const nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>& prior_information,
                 double radius_start, double radius_end, double sigma, double robust, double facing,
                 std::int32_t iterations, double correlated, int threads) {
    const auto clouds = static_cast<std::int64_t>(origins.shape(0));
    const auto sources = static_cast<std::int64_t>(offsets.shape(0)) - 1;
    const std::size_t m = pairs.shape(0), targets_n = entries.shape(0);
    require(normals.shape(0) == points.shape(0) && weights.shape(0) == points.shape(0),
            "align: arrays of the sources differ in length");
    require(static_cast<std::int64_t>(target_offsets.shape(0)) == clouds + 1 && sources >= 0 &&
                static_cast<std::int64_t>(starts_offsets.shape(0)) == clouds + 1 &&
                static_cast<std::int64_t>(shapes.shape(0)) == clouds &&
                static_cast<std::int64_t>(cells.shape(0)) == clouds, "align: offsets do not fit the clouds");
    require(T_start.shape(0) == m && T_prior.shape(0) == m && prior_information.shape(0) == m,
            "align: one start and one prior a pair");
    require(radius_start >= radius_end && radius_end > 0 && sigma > 0 && robust > 0 && iterations > 0,
            "align: radii, sigma, robust and iterations must be positive");
    require(correlated >= 0 && std::isfinite(correlated), "align: the length of correlation must not be negative");
    require(target_offsets.data()[clouds] == static_cast<std::int64_t>(targets_n) && target_offsets.data()[0] == 0 &&
                starts_offsets.data()[0] == 0 && std::is_sorted(target_offsets.data(), target_offsets.data() + clouds + 1) &&
                std::is_sorted(starts_offsets.data(), starts_offsets.data() + clouds + 1) &&
                offsets.data()[sources] == static_cast<std::int64_t>(points.shape(0)) && offsets.data()[0] == 0 &&
                starts_offsets.data()[clouds] == static_cast<std::int64_t>(starts.shape(0)),
            "align: offsets do not fit the arrays");
    require(std::is_sorted(offsets.data(), offsets.data() + offsets.shape(0)), "align: offsets must rise");
    require_finite(entries, "align: points of the targets must be finite");
    for (const auto* array : {&points, &origins}) require_finite(*array, "align: points must be finite");
    for (const auto* array : {&T_start, &T_prior}) require_finite(*array, "align: poses must be finite");
    require_finite(prior_information, "align: the information of the prior must be finite");
    require(std::isfinite(radius_start), "align: radius_start must be finite");
    for (std::int64_t c = 0; c < clouds; ++c)
        require_index(target_offsets.data() + c, starts_offsets.data() + c, shapes.data() + 2 * c, cells.data()[c],
                      starts.data());
    for (std::size_t k = 0; k < m; ++k)
        require(pairs.data()[2 * k] >= 0 && pairs.data()[2 * k] < clouds && pairs.data()[2 * k + 1] >= 0 &&
                    pairs.data()[2 * k + 1] < sources, "align: a pair names a cloud that does not exist");

    std::vector<double> poses(3 * m), information(9 * m), steps(3 * m), overlap(m), rms(m), correlation(m), variance(m),
        push(9 * m), spread(9 * m);
    const AlignOptions options{radius_start, radius_end, sigma, robust, facing, iterations, correlated};
    const auto work = [&](std::size_t first, std::size_t last) {
        for (std::size_t k = first; k < last; ++k) {
            const std::int32_t a = pairs.data()[2 * k], b = pairs.data()[2 * k + 1];
            const std::int64_t at = target_offsets.data()[a], from = offsets.data()[b], to = offsets.data()[b + 1];
            const PointIndexView target{reinterpret_cast<const Entry*>(entries.data()) + at, starts.data() + starts_offsets.data()[a],
                                        origins.data()[2 * a], origins.data()[2 * a + 1], cells.data()[a],
                                        shapes.data()[2 * a], shapes.data()[2 * a + 1]};
            const double* t = T_start.data() + 3 * k;
            const double* p = T_prior.data() + 3 * k;
            const AlignResult r = align(target, points.data() + 2 * from, normals.data() + 2 * from, weights.data() + from,
                                        static_cast<std::size_t>(to - from), {t[0], t[1], t[2]}, {p[0], p[1], p[2]},
                                        prior_information.data() + 9 * k, options);
            poses[3 * k] = r.pose.x; poses[3 * k + 1] = r.pose.y; poses[3 * k + 2] = r.pose.theta;
            std::copy(r.information, r.information + 9, information.begin() + static_cast<std::ptrdiff_t>(9 * k));
            std::copy(r.step, r.step + 3, steps.begin() + static_cast<std::ptrdiff_t>(3 * k));
            overlap[k] = r.overlap;
            rms[k] = r.rms;
            correlation[k] = r.correlation;
            variance[k] = r.variance;
            std::copy(r.push, r.push + 9, push.begin() + static_cast<std::ptrdiff_t>(9 * k));
            std::copy(r.spread, r.spread + 9, spread.begin() + static_cast<std::ptrdiff_t>(9 * k));
        }
    };
    {
        nb::gil_scoped_release release;
        const std::size_t crew = std::min<std::size_t>(static_cast<std::size_t>(std::max(threads, 1)), std::max<std::size_t>(m, 1));
        std::vector<std::thread> helpers;
        for (std::size_t w = 1; w < crew; ++w) helpers.emplace_back(work, m * w / crew, m * (w + 1) / crew);
        work(0, m / crew);
        for (auto& helper : helpers) helper.join();
    }
    return nb::make_tuple(own(std::move(poses), {m, 3}), own(std::move(information), {m, 3, 3}), own(std::move(steps), {m, 3}),
                          own(std::move(overlap), {m}), own(std::move(rms), {m}),
                          own(std::move(correlation), {m}), own(std::move(variance), {m}),
                          own(std::move(push), {m, 3, 3}), own(std::move(spread), {m, 3, 3}));
}

}  // namespace

void bind_scan(nb::module_ m) {
    bind_clouds(m);
    m.def("sort_into_buckets", &sort_into_buckets_);
    m.def("build_pyramid", &build_pyramid_);
    m.def("correlate", &correlate_);
    m.def("align", &align_);
}

}  // namespace clew
