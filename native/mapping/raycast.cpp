#include "raycast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clew::mapping {

namespace {

constexpr std::uint16_t full = std::numeric_limits<std::uint16_t>::max();

struct Point {
    double x, y;
};

// A sensor's pose in the units of the window: cells from its outer corner.
class Sensor {
public:
    Sensor(const double* T_world_sensor, double scale, double first_col, double first_row)
        : origin_{T_world_sensor[0] * scale - first_col, T_world_sensor[1] * scale - first_row},
          cos_(std::cos(T_world_sensor[2]) * scale), sin_(std::sin(T_world_sensor[2]) * scale) {}

    Point origin() const { return origin_; }
    Point act(const double* p) const {
        return {origin_.x + cos_ * p[0] - sin_ * p[1], origin_.y + sin_ * p[0] + cos_ * p[1]};
    }

private:
    Point origin_;
    double cos_, sin_;
};

Sensor sensor_in(const Window& window, const double* T_world_sensor) {
    return {T_world_sensor, 1.0 / window.resolution, static_cast<double>(window.first_col),
            static_cast<double>(window.first_row)};
}

// The cell at a point, or null outside of the window.
Cell* cell_at(const Window& window, Point p) {
    const double col = std::floor(p.x), row = std::floor(p.y);
    if (!(col >= 0.0 && row >= 0.0 && col < static_cast<double>(window.cols) &&
          row < static_cast<double>(window.rows))) {
        return nullptr;
    }
    return window.cells + static_cast<std::int64_t>(row) * window.cols + static_cast<std::int64_t>(col);
}

void count_hit(Cell& cell, std::uint16_t stamp) {
    if (cell.stamp == stamp) return;
    cell.stamp = stamp;
    if (cell.hits != full) ++cell.hits;
}

void count_miss(Cell& cell, std::uint16_t stamp) {
    if (cell.stamp == stamp) return;
    cell.stamp = stamp;
    if (cell.misses != full) ++cell.misses;
}

// Walk along one axis: the ray's parameter (0 at its start, 1 at its end) at the next border, and between borders.
struct Axis {
    std::int64_t step;
    double next, delta;

    Axis(double from, double to) {
        const double length = to - from;
        step = length > 0.0 ? 1 : -1;
        delta = length == 0.0 ? std::numeric_limits<double>::infinity() : 1.0 / std::abs(length);
        const double border = length > 0.0 ? std::floor(from) + 1.0 - from : from - std::floor(from);
        next = length == 0.0 ? std::numeric_limits<double>::infinity() : border * delta;
    }
};

// Count a miss in every cell from `from` to `to`, both included: exact traversal in the order of the ray
// (Amanatides & Woo, A Fast Voxel Traversal Algorithm for Ray Tracing, Eurographics 1987). The number of steps is
// known beforehand, so that rounding cannot make the walk run past its end.
void trace(const Window& window, Point from, Point to, std::uint16_t stamp) {
    const auto col = static_cast<std::int64_t>(std::floor(from.x));
    const auto row = static_cast<std::int64_t>(std::floor(from.y));
    Axis x(from.x, to.x), y(from.y, to.y);
    const std::int64_t row_step = y.step * window.cols;
    const std::int64_t steps_x = std::abs(static_cast<std::int64_t>(std::floor(to.x)) - col);
    const std::int64_t steps_y = std::abs(static_cast<std::int64_t>(std::floor(to.y)) - row);
    // Cut the walk where it would leave the window; both ends of an axis are within it or beyond one side.
    const std::int64_t room_x = x.step > 0 ? window.cols - 1 - col : col;
    const std::int64_t room_y = y.step > 0 ? window.rows - 1 - row : row;

    Cell* cell = window.cells + row * window.cols + col;
    count_miss(*cell, stamp);
    std::int64_t walked_x = 0, walked_y = 0;
    while (walked_x < steps_x || walked_y < steps_y) {
        if (walked_y >= steps_y || (walked_x < steps_x && x.next < y.next)) {
            if (++walked_x > room_x) return;
            x.next += x.delta;
            cell += x.step;
        } else {
            if (++walked_y > room_y) return;
            y.next += y.delta;
            cell += row_step;
        }
        count_miss(*cell, stamp);
    }
}

void cast_scan(const Window& window, const Rays& rays, std::size_t scan, double margin, std::uint16_t stamp) {
    const Sensor sensor = sensor_in(window, rays.T_world_sensor + 3 * scan);
    const Point origin = sensor.origin();
    const std::int64_t begin = rays.offsets[scan], end = rays.offsets[scan + 1];
    for (std::int64_t b = begin; b < end; ++b) {
        if (!rays.hit[b]) continue;
        if (Cell* cell = cell_at(window, sensor.act(rays.endpoints + 2 * b))) count_hit(*cell, stamp);
    }
    if (cell_at(window, origin) == nullptr) return;
    for (std::int64_t b = begin; b < end; ++b) {
        const double* p = rays.endpoints + 2 * b;
        double keep = 1.0;
        if (rays.hit[b]) {
            const double range = std::sqrt(p[0] * p[0] + p[1] * p[1]);
            if (range <= margin) continue;
            keep = 1.0 - margin / range;
        }
        const double shortened[2] = {keep * p[0], keep * p[1]};
        trace(window, origin, sensor.act(shortened), stamp);
    }
}

}  // namespace

std::uint16_t cast(const Window& window, const Rays& rays, double margin, std::uint16_t stamp) {
    for (std::size_t scan = 0; scan < rays.scans; ++scan) {
        if (stamp == full) {
            for (std::int64_t i = 0; i < window.rows * window.cols; ++i) window.cells[i].stamp = 0;
            stamp = 0;
        }
        cast_scan(window, rays, scan, margin, ++stamp);
    }
    return stamp;
}

void bounds(const Rays& rays, double box[4]) {
    const double infinity = std::numeric_limits<double>::infinity();
    Point low{infinity, infinity}, high{-infinity, -infinity};
    auto include = [&](Point p) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    };
    for (std::size_t scan = 0; scan < rays.scans; ++scan) {
        const Sensor sensor(rays.T_world_sensor + 3 * scan, 1.0, 0.0, 0.0);
        include(sensor.origin());
        for (std::int64_t b = rays.offsets[scan]; b < rays.offsets[scan + 1]; ++b) {
            include(sensor.act(rays.endpoints + 2 * b));
        }
    }
    box[0] = low.x, box[1] = low.y, box[2] = high.x, box[3] = high.y;
}

}  // namespace clew::mapping
