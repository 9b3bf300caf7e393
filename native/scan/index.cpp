#include "index.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace clew::scan {

void sort_into_buckets(const double* points, std::size_t n, double origin_x, double origin_y, double cell,
                       std::int32_t width, std::int32_t height, std::int32_t* starts, std::int32_t* order) {
    const std::size_t cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::vector<std::int32_t> bucket(n);
    std::fill(starts, starts + cells + 1, 0);
    for (std::size_t i = 0; i < n; ++i) {
        const double cx = std::floor((points[2 * i] - origin_x) / cell);
        const double cy = std::floor((points[2 * i + 1] - origin_y) / cell);
        const auto x = static_cast<std::int32_t>(std::clamp(cx, 0.0, width - 1.0));
        const auto y = static_cast<std::int32_t>(std::clamp(cy, 0.0, height - 1.0));
        bucket[i] = y * width + x;
        ++starts[bucket[i] + 1];
    }
    for (std::size_t b = 0; b < cells; ++b) starts[b + 1] += starts[b];
    std::vector<std::int32_t> next(starts, starts + cells);
    for (std::size_t i = 0; i < n; ++i) order[next[static_cast<std::size_t>(bucket[i])]++] = static_cast<std::int32_t>(i);
}

std::size_t group_surfels(const double* points, const double* normals, std::size_t n, double voxel,
                          std::int32_t* group) {
    std::unordered_map<std::uint64_t, std::int32_t> seen;
    seen.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
        const auto cx = static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(points[2 * i] / voxel)) + (1 << 29));
        const auto cy = static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(points[2 * i + 1] / voxel)) + (1 << 29));
        // The two sides of a thin wall lie in one voxel but look in opposite directions: keep them apart.
        const std::uint64_t facing = (normals[2 * i] > 0 ? 1u : 0u) | (normals[2 * i + 1] > 0 ? 2u : 0u);
        const std::uint64_t key = (cx << 33) ^ (cy << 2) ^ facing;
        group[i] = seen.try_emplace(key, static_cast<std::int32_t>(seen.size())).first->second;
    }
    return seen.size();
}

}  // namespace clew::scan
