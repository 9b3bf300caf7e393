#include "returns.hpp"

#include <algorithm>
#include <cmath>

namespace clew::scan {

void deskew(const double* ranges, const double* angles, const double* delays, std::size_t n, const Pose& velocity,
            const Pose& T_robot_sensor, double* still_ranges, double* bearings) {
    const Pose& at = T_robot_sensor;
    const double c_at = std::cos(at.theta), s_at = std::sin(at.theta);
    for (std::size_t i = 0; i < n; ++i) {
        const double turn = delays[i] * velocity.theta, direction = angles[i] + turn;
        if (!std::isfinite(ranges[i])) {
            still_ranges[i] = ranges[i];
            bearings[i] = direction;
            continue;
        }
        // Motion of the robot until this beam: exp of the twist, whose chord points half of the turn aside.
        const double half = 0.5 * turn, c_half = std::cos(half), s_half = std::sin(half);
        const double chord = delays[i] * (half != 0.0 ? s_half / half : 1.0);
        const double moved_x = chord * (c_half * velocity.x - s_half * velocity.y);
        const double moved_y = chord * (s_half * velocity.x + c_half * velocity.y);
        // The return in the robot's frame, turned and moved with it, seen from the sensor at the timestamp.
        const double c = std::cos(turn), s = std::sin(turn);
        const double x = ranges[i] * std::cos(direction + at.theta) + c * at.x - s * at.y + moved_x - at.x;
        const double y = ranges[i] * std::sin(direction + at.theta) + s * at.x + c * at.y + moved_y - at.y;
        const double sx = c_at * x + s_at * y, sy = c_at * y - s_at * x;
        still_ranges[i] = std::sqrt(sx * sx + sy * sy);
        bearings[i] = std::atan2(sy, sx);
    }
}

Cloud extract_returns(const double* ranges, const double* angles, std::size_t n, const Pose& T_robot_sensor,
                      const ExtractOptions& o, std::vector<std::int32_t>& beams) {
    std::vector<double> points;
    points.reserve(2 * n);
    beams.clear();
    beams.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
        const double r = ranges[i];
        if (!(r >= o.nearest && r <= o.farthest)) continue;  // nor what is no number
        beams.push_back(static_cast<std::int32_t>(i));
        points.push_back(r * std::cos(angles[i]));
        points.push_back(r * std::sin(angles[i]));
    }
    const std::size_t count = beams.size();
    std::vector<double> normals(2 * count), ratio(count);
    std::vector<std::int32_t> support(count);
    surface_normals(points.data(), beams.data(), count, o.surface, normals.data(), ratio.data(), support.data());
    Cloud out;
    out.points.reserve(2 * count);
    out.normals.reserve(2 * count);
    out.along.reserve(count);
    out.weights.reserve(count);
    const double c = std::cos(T_robot_sensor.theta), s = std::sin(T_robot_sensor.theta);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < count; ++k) {
        if (support[k] <= 0) continue;
        const double x = points[2 * k], y = points[2 * k + 1], nx = normals[2 * k], ny = normals[2 * k + 1];
        out.points.push_back(c * x - s * y + T_robot_sensor.x);
        out.points.push_back(s * x + c * y + T_robot_sensor.y);
        out.normals.push_back(c * nx - s * ny);
        out.normals.push_back(s * nx + c * ny);
        out.along.push_back(ratio[k] > o.blob ? ratio[k] : 0.0);
        out.weights.push_back(std::clamp(ranges[beams[k]] * o.weight_per_metre, 0.1, 1.0));
        beams[kept++] = beams[k];
    }
    beams.resize(kept);
    return out;
}

Cloud between_returns(const CloudView& cloud, const FillOptions& o) {
    Cloud out;
    for (std::size_t i = 0; i + 1 < cloud.n; ++i) {
        const double *p = cloud.points + 2 * i, *n = cloud.normals + 2 * i;
        const double x = p[2] - p[0], y = p[3] - p[1], length = std::sqrt(x * x + y * y);
        const double gap = o.gap_base + o.gap_per_metre * std::sqrt(p[0] * p[0] + p[1] * p[1]);
        const double across = std::max(std::abs(x * n[0] + y * n[1]), std::abs(x * n[2] + y * n[3]));
        const bool facing = n[0] * n[2] + n[1] * n[3] > 0;
        if (!(length > o.step && length <= gap && across <= o.flat * length && facing)) continue;
        const auto more = static_cast<std::size_t>(std::ceil(length / o.step)) - 1;
        for (std::size_t k = 1; k <= more; ++k) {
            const double share = static_cast<double>(k) / static_cast<double>(more + 1);
            const double nx = (1.0 - share) * n[0] + share * n[2], ny = (1.0 - share) * n[1] + share * n[3];
            const double norm = std::sqrt(nx * nx + ny * ny);
            out.points.push_back(p[0] + share * x);
            out.points.push_back(p[1] + share * y);
            out.normals.push_back(nx / norm);
            out.normals.push_back(ny / norm);
            out.along.push_back(0.0);
            out.weights.push_back(o.weight * cloud.weights[i]);
        }
    }
    return out;
}

}  // namespace clew::scan
