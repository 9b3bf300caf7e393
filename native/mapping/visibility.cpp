#include "visibility.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace clew::mapping {

namespace {

// atan2 to 2e-5 rad, a thousandth of the angle between two beams, in a form that compilers turn into vector
// instructions (Abramowitz & Stegun, Handbook of Mathematical Functions, 4.4.49).
double direction(double x, double y) {
    const double ax = std::abs(x), ay = std::abs(y);
    const double t = std::min(ax, ay) / std::max(std::max(ax, ay), 1e-12), s = t * t;
    double angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))));
    angle = ay > ax ? 0.5 * std::numbers::pi - angle : angle;
    angle = x < 0 ? std::numbers::pi - angle : angle;
    return y < 0 ? -angle : angle;
}

}  // namespace

void see(const Views& v, const double* points, std::size_t count, double slack, std::int32_t* seen,
         std::int32_t* through) {
    std::fill(seen, seen + count, 0);
    std::fill(through, through + count, 0);
    std::vector<double> beam(count), distance(count);
    for (std::size_t k = 0; k < v.views; ++k) {
        const double* pose = v.T_sensor_points + 3 * k;
        const double c = std::cos(pose[2]), s = std::sin(pose[2]), per_beam = 1 / v.increment[k];
        const auto beams = static_cast<double>(v.offsets[k + 1] - v.offsets[k]);
        constexpr double half_turn = std::numbers::pi, turn = 2 * half_turn;
        double middle = v.first_angle[k] + 0.5 * (beams - 1) * v.increment[k];
        middle -= turn * std::floor(middle / turn + 0.5);
        for (std::size_t i = 0; i < count; ++i) {
            const double x = pose[0] + c * points[2 * i] - s * points[2 * i + 1];
            const double y = pose[1] + s * points[2 * i] + c * points[2 * i + 1];
            double off = direction(x, y) - middle;
            off = off > half_turn ? off - turn : off;  // within half a turn of the middle beam
            off = off < -half_turn ? off + turn : off;
            beam[i] = off * per_beam + 0.5 * (beams - 1);
            distance[i] = std::sqrt(x * x + y * y);
        }
        const double* range = v.range + v.offsets[k];
        const double* clear = v.clear + v.offsets[k];
        for (std::size_t i = 0; i < count; ++i) {
            if (!(beam[i] >= 0 && beam[i] < beams - 1)) continue;
            const auto left = static_cast<std::size_t>(beam[i]);
            const double d = distance[i];
            if (std::abs(range[left] - d) <= slack || std::abs(range[left + 1] - d) <= slack) ++seen[i];
            else if (clear[left] > d && clear[left + 1] > d) ++through[i];
        }
    }
}

}  // namespace clew::mapping
