#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "correlate.hpp"

namespace clew::scan {

namespace {

// out[i] = max(in[i], in[i + reach]) along rows; cells past the end count as empty.
void widen_rows(const std::uint8_t* in, std::uint8_t* out, std::int32_t height, std::int32_t width, std::int32_t reach) {
    for (std::int32_t y = 0; y < height; ++y) {
        const std::uint8_t* row = in + static_cast<std::ptrdiff_t>(y) * width;
        std::uint8_t* target = out + static_cast<std::ptrdiff_t>(y) * width;
        const std::int32_t inner = std::max(width - reach, 0);
        for (std::int32_t x = 0; x < inner; ++x) target[x] = std::max(row[x], row[x + reach]);
        for (std::int32_t x = inner; x < width; ++x) target[x] = row[x];
    }
}

void widen_columns(const std::uint8_t* in, std::uint8_t* out, std::int32_t height, std::int32_t width, std::int32_t reach) {
    for (std::int32_t y = 0; y < height; ++y) {
        const std::uint8_t* row = in + static_cast<std::ptrdiff_t>(y) * width;
        std::uint8_t* target = out + static_cast<std::ptrdiff_t>(y) * width;
        if (y + reach < height) {
            const std::uint8_t* other = row + static_cast<std::ptrdiff_t>(reach) * width;
            for (std::int32_t x = 0; x < width; ++x) target[x] = std::max(row[x], other[x]);
        } else {
            std::memcpy(target, row, static_cast<std::size_t>(width));
        }
    }
}

}  // namespace

void build_pyramid(const double* points, std::size_t n, double sigma, const PyramidView& shape, std::uint8_t* cells) {
    const std::int32_t width = shape.width, height = shape.height;
    const std::size_t area = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::fill(cells, cells + area, std::uint8_t{0});

    // A Gaussian about each point, at the precision of a quarter cell: the stamp depends on where in its cell the
    // point lies, and is tabulated for 4 x 4 positions.
    constexpr std::int32_t parts = 4;
    const auto radius = static_cast<std::int32_t>(std::ceil(2.5 * sigma / shape.resolution));
    const std::int32_t side = 2 * radius + 1;
    std::vector<std::uint8_t> stamps(static_cast<std::size_t>(parts * parts * side * side));
    for (std::int32_t s = 0; s < parts * parts; ++s) {
        const double fx = (s % parts + 0.5) / parts - 0.5, fy = (s / parts + 0.5) / parts - 0.5;
        for (std::int32_t k = 0; k < side * side; ++k) {
            const double dx = (k % side - radius - fx) * shape.resolution, dy = (k / side - radius - fy) * shape.resolution;
            const double value = std::exp(-0.5 * (dx * dx + dy * dy) / (sigma * sigma));
            stamps[static_cast<std::size_t>(s * side * side + k)] = static_cast<std::uint8_t>(std::lround(255.0 * value));
        }
    }
    for (std::size_t i = 0; i < n; ++i) {
        const double gx = (points[2 * i] - shape.origin_x) / shape.resolution;
        const double gy = (points[2 * i + 1] - shape.origin_y) / shape.resolution;
        if (!(gx >= radius && gy >= radius && gx < width - radius && gy < height - radius)) continue;
        const auto x = static_cast<std::int32_t>(gx), y = static_cast<std::int32_t>(gy);
        const auto sx = static_cast<std::int32_t>((gx - x) * parts), sy = static_cast<std::int32_t>((gy - y) * parts);
        const std::uint8_t* stamp = stamps.data() + static_cast<std::ptrdiff_t>((sy * parts + sx) * side * side);
        for (std::int32_t dy = 0; dy < side; ++dy) {
            std::uint8_t* row = cells + static_cast<std::ptrdiff_t>(y + dy - radius) * width + (x - radius);
            for (std::int32_t dx = 0; dx < side; ++dx) row[dx] = std::max(row[dx], stamp[dy * side + dx]);
        }
    }
    std::vector<std::uint8_t> scratch(area);
    for (std::int32_t level = 1; level < shape.levels; ++level) {
        const std::int32_t reach = 1 << (level - 1);
        const std::uint8_t* below = cells + static_cast<std::size_t>(level - 1) * area;
        widen_rows(below, scratch.data(), height, width, reach);
        widen_columns(scratch.data(), cells + static_cast<std::size_t>(level) * area, height, width, reach);
    }
}

}  // namespace clew::scan
