#include "surface.hpp"

#include <algorithm>
#include <cmath>

namespace clew::scan {

namespace {

// Last neighbour of i in the direction `step` that belongs to the same surface.
std::ptrdiff_t reach(const double* points, const std::int32_t* beams, std::ptrdiff_t n, std::ptrdiff_t i,
                     std::ptrdiff_t step, const SurfaceOptions& o) {
    const double px = points[2 * i], py = points[2 * i + 1];
    std::ptrdiff_t last = i;
    for (std::ptrdiff_t k = 1; k <= o.window; ++k) {
        const std::ptrdiff_t j = i + step * k;
        if (j < 0 || j >= n || std::abs(beams[j] - beams[last]) > 2) break;
        const double x = points[2 * j], y = points[2 * j + 1];
        const double sx = x - points[2 * last], sy = y - points[2 * last + 1];
        const double gap = o.gap_base + o.gap_per_metre * std::min(std::hypot(x, y), std::hypot(px, py));
        if (sx * sx + sy * sy > gap * gap) break;
        if ((x - px) * (x - px) + (y - py) * (y - py) > o.radius * o.radius) break;
        last = j;
    }
    return last;
}

}  // namespace

void surface_normals(const double* points, const std::int32_t* beams, std::size_t count, const SurfaceOptions& o,
                     double* normals, double* along, std::int32_t* support) {
    const auto n = static_cast<std::ptrdiff_t>(count);
    for (std::ptrdiff_t i = 0; i < n; ++i) {
        const std::ptrdiff_t first = reach(points, beams, n, i, -1, o), last = reach(points, beams, n, i, 1, o);
        const double px = points[2 * i], py = points[2 * i + 1];
        double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
        const auto m = static_cast<double>(last - first + 1);
        for (std::ptrdiff_t j = first; j <= last; ++j) {
            const double dx = points[2 * j] - px, dy = points[2 * j + 1] - py;
            mx += dx; my += dy;
            xx += dx * dx; xy += dx * dy; yy += dy * dy;
        }
        mx /= m; my /= m;
        xx = xx / m - mx * mx; xy = xy / m - mx * my; yy = yy / m - my * my;
        // Principal direction of the 2x2 covariance in closed form.
        const double half_trace = 0.5 * (xx + yy), half_difference = 0.5 * (xx - yy);
        const double root = std::hypot(half_difference, xy);
        const double major = half_trace + root, minor = std::max(half_trace - root, 0.0);
        const double direction = 0.5 * std::atan2(2.0 * xy, xx - yy);
        double nx = -std::sin(direction), ny = std::cos(direction);
        if (nx * px + ny * py > 0) { nx = -nx; ny = -ny; }
        normals[2 * i] = nx;
        normals[2 * i + 1] = ny;
        along[i] = major > 0 ? std::sqrt(minor / major) : 1.0;
        support[i] = static_cast<std::int32_t>(last - first);
    }
}

}  // namespace clew::scan
