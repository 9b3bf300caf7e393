#include "surface.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace clew::scan {

namespace {

struct Moments {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
};

struct Line {
    double nx, ny, major, minor;  // deviations along and across, metres
};

// Last neighbour of i in the direction `step` that belongs to the same surface.
std::ptrdiff_t reach(const double* points, const std::int32_t* beams, std::ptrdiff_t n, std::ptrdiff_t i,
                     std::ptrdiff_t step, const SurfaceOptions& o) {
    const double px = points[2 * i], py = points[2 * i + 1], range = std::hypot(px, py);
    const double gap = o.gap_base + o.gap_per_metre * range;
    std::ptrdiff_t last = i;
    for (std::ptrdiff_t k = 1; k <= o.window; ++k) {
        const std::ptrdiff_t j = i + step * k;
        if (j < 0 || j >= n || std::abs(beams[j] - beams[last]) > 2) break;
        const double x = points[2 * j], y = points[2 * j + 1];
        const double sx = x - points[2 * last], sy = y - points[2 * last + 1];
        if (sx * sx + sy * sy > gap * gap) break;
        if (k > 2 && (x - px) * (x - px) + (y - py) * (y - py) > o.radius * o.radius) break;
        last = j;
    }
    return last;
}

// Principal directions of the points [first, last], from running sums, in closed form.
Line fit(const std::vector<Moments>& sums, std::ptrdiff_t first, std::ptrdiff_t last) {
    const Moments& a = sums[static_cast<std::size_t>(first)];
    const Moments& b = sums[static_cast<std::size_t>(last + 1)];
    const double m = b.n - a.n, mx = (b.x - a.x) / m, my = (b.y - a.y) / m;
    const double xx = (b.xx - a.xx) / m - mx * mx, xy = (b.xy - a.xy) / m - mx * my, yy = (b.yy - a.yy) / m - my * my;
    const double half_trace = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
    const double direction = 0.5 * std::atan2(2.0 * xy, xx - yy);
    return {-std::sin(direction), std::cos(direction), std::sqrt(std::max(half_trace + root, 0.0)),
            std::sqrt(std::max(half_trace - root, 0.0))};
}

}  // namespace

void surface_normals(const double* points, const std::int32_t* beams, std::size_t count, const SurfaceOptions& o,
                     double* normals, double* ratio, std::int32_t* support) {
    // A one-sided neighbourhood serves a return beside a corner, if its points lie this much better on a line.
    constexpr double corner = 0.6;
    constexpr std::ptrdiff_t least_side = 3;
    const auto n = static_cast<std::ptrdiff_t>(count);
    std::vector<Moments> sums(count + 1);
    for (std::size_t i = 0; i < count; ++i) {
        const double x = points[2 * i], y = points[2 * i + 1];
        const Moments& s = sums[i];
        sums[i + 1] = {s.n + 1, s.x + x, s.y + y, s.xx + x * x, s.xy + x * y, s.yy + y * y};
    }
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        const std::ptrdiff_t first = reach(points, beams, n, i, -1, o), last = reach(points, beams, n, i, 1, o);
        Line line = fit(sums, first, last);
        if (last - first >= 2) {
            const double limit = corner * line.minor;
            for (const auto& [from, to] : {std::pair{first, i}, std::pair{i, last}}) {
                if (to - from < least_side) continue;
                const Line side = fit(sums, from, to);
                if (side.minor < limit && side.minor < line.minor) line = side;
            }
        }
        if (line.nx * points[2 * i] + line.ny * points[2 * i + 1] > 0) { line.nx = -line.nx; line.ny = -line.ny; }
        normals[2 * i] = line.nx;
        normals[2 * i + 1] = line.ny;
        ratio[i] = line.major > 0 ? line.minor / line.major : 1.0;
        support[i] = static_cast<std::int32_t>(last - first);
    }
}

}  // namespace clew::scan
