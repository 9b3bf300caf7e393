#include "index.hpp"

#include <algorithm>
#include <cmath>

namespace clew::scan {

void sort_into_buckets(const double* points, const double* normals, const double* along, std::size_t n, double origin_x,
                       double origin_y, double cell, std::int32_t width, std::int32_t height, std::int32_t* starts,
                       Entry* entries) {
    const std::size_t cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::vector<std::int32_t> bucket(n);
    std::fill(starts, starts + cells + 1, 0);
    for (std::size_t i = 0; i < n; ++i) {
        // Truncation is floor where nothing is negative.
        const auto x = static_cast<std::int32_t>(std::clamp((points[2 * i] - origin_x) / cell, 0.0, width - 1.0));
        const auto y = static_cast<std::int32_t>(std::clamp((points[2 * i + 1] - origin_y) / cell, 0.0, height - 1.0));
        bucket[i] = y * width + x;
        ++starts[bucket[i] + 1];
    }
    for (std::size_t b = 0; b < cells; ++b) starts[b + 1] += starts[b];
    std::vector<std::int32_t> next(starts, starts + cells);
    for (std::size_t i = 0; i < n; ++i)
        entries[next[static_cast<std::size_t>(bucket[i])]++] = {points[2 * i], points[2 * i + 1], normals[2 * i],
                                                                normals[2 * i + 1], along[i]};
}

namespace {

// Square and quadrant of the normal in one number: the two sides of a thin wall lie in one square, but are kept apart.
std::uint64_t key_of(const double* point, const double* normal, double voxel) {
    const auto square = [voxel](double v) {
        return static_cast<std::uint64_t>(floor_to<std::int64_t>(std::clamp(v / voxel, -1e15, 1e15)) + (1 << 29));
    };
    const std::uint64_t facing = (normal[0] > 0 ? 1u : 0u) | (normal[1] > 0 ? 2u : 0u);
    return (square(point[0]) << 33) ^ (square(point[1]) << 2) ^ facing;
}

// Numbers of keys in order of first appearance; open addressing in a table at most half full.
class Numbering {
public:
    explicit Numbering(std::size_t most) {
        while (size_ < 2 * most) size_ *= 2;
        keys_.resize(size_);
        numbers_.assign(size_, -1);
    }

    std::int32_t operator()(std::uint64_t key) {
        // Fibonacci hashing (Knuth, TAOCP 3, 6.4): neighbouring squares land far apart.
        std::size_t at = static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ull) >> 20) & (size_ - 1);
        for (; numbers_[at] >= 0; at = (at + 1) & (size_ - 1))
            if (keys_[at] == key) return numbers_[at];
        keys_[at] = key;
        return numbers_[at] = count_++;
    }

    std::size_t count() const { return static_cast<std::size_t>(count_); }

private:
    std::size_t size_ = 16;
    std::int32_t count_ = 0;
    std::vector<std::uint64_t> keys_;
    std::vector<std::int32_t> numbers_;
};

}  // namespace

Surfels merge_surfels(const double* points, const double* normals, const double* along, const double* weights,
                      std::size_t n, double voxel) {
    struct Sums {
        double weight = 0, x = 0, y = 0, nx = 0, ny = 0, along = 0;
    };
    Numbering number(n);
    std::vector<Sums> sums;
    sums.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
        const auto group = static_cast<std::size_t>(number(key_of(points + 2 * i, normals + 2 * i, voxel)));
        if (group == sums.size()) sums.emplace_back();
        Sums& s = sums[group];
        const double w = weights[i];
        s.weight += w;
        s.x += w * points[2 * i];
        s.y += w * points[2 * i + 1];
        s.nx += w * normals[2 * i];
        s.ny += w * normals[2 * i + 1];
        s.along += w * along[i];
    }
    Surfels out;
    out.points.reserve(2 * sums.size());
    out.normals.reserve(2 * sums.size());
    out.along.reserve(sums.size());
    for (const Sums& s : sums) {
        const double length = std::max(std::sqrt(s.nx * s.nx + s.ny * s.ny), 1e-12 * s.weight);
        out.points.push_back(s.x / s.weight);
        out.points.push_back(s.y / s.weight);
        out.normals.push_back(s.nx / length);
        out.normals.push_back(s.ny / length);
        out.along.push_back(s.along / s.weight);
    }
    return out;
}

}  // namespace clew::scan
