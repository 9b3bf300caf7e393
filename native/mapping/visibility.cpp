#include "visibility.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace clew::mapping {

void see(const Views& v, const double* points, std::size_t count, double slack, std::int32_t* seen,
         std::int32_t* through) {
    std::fill(seen, seen + count, 0);
    std::fill(through, through + count, 0);
    std::vector<double> beam(count), distance(count);
    for (std::size_t k = 0; k < v.views; ++k) {
        const double* pose = v.T_sensor_points + 3 * k;
        const auto beams = static_cast<double>(v.offsets[k + 1] - v.offsets[k]);
        const double half = 0.5 * (beams - 1), turn = 2 * std::numbers::pi;
        double middle = v.first_angle[k] + half * v.increment[k];
        middle -= turn * std::floor(middle / turn + 0.5);
        const Beams sensor{pose[0], pose[1], std::cos(pose[2]), std::sin(pose[2]), middle, 1 / v.increment[k], half};
        CLEW_DISPATCH(beams_at)(sensor, points, count, beam.data(), distance.data());
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
