// Grid traversal after Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing" (Eurographics 1987).
#include "sim/raycast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clew::sim {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kCell = 1.0;                // metres: rooms and corridors are a few cells wide
constexpr double kMaxCells = 4.0e6;          // larger worlds get larger cells
constexpr double kMargin = 1e-6;             // metres by which a segment is thickened when it is put into cells
constexpr double kCorner = 1e-12;            // relative overlap of segments, so that no ray slips through a corner

// Distance along the ray to the segment; a parallel or zero-length segment is not hit (it is seen edge on).
double hit(const Segment& s, double x, double y, double dx, double dy) {
    const double ex = s.x1 - s.x0, ey = s.y1 - s.y0;
    const double det = dx * ey - dy * ex;
    if (det == 0.0) return kInfinity;
    const double rx = s.x0 - x, ry = s.y0 - y;
    const double along_segment = (rx * dy - ry * dx) / det;
    if (along_segment < -kCorner || along_segment > 1.0 + kCorner) return kInfinity;
    const double along_ray = (rx * ey - ry * ex) / det;
    return along_ray >= 0.0 ? along_ray : kInfinity;
}

}  // namespace

SegmentGrid::SegmentGrid(const double* segments, std::size_t count) {
    segments_.reserve(count);
    double x1 = -kInfinity, y1 = -kInfinity;
    x0_ = y0_ = kInfinity;
    for (std::size_t i = 0; i < count; ++i) {
        const double* s = segments + 4 * i;
        segments_.push_back({s[0], s[1], s[2], s[3]});
        x0_ = std::min({x0_, s[0], s[2]});
        y0_ = std::min({y0_, s[1], s[3]});
        x1 = std::max({x1, s[0], s[2]});
        y1 = std::max({y1, s[1], s[3]});
    }
    if (count == 0) return;
    x0_ -= 2 * kMargin;
    y0_ -= 2 * kMargin;
    const double width = x1 - x0_ + 2 * kMargin, height = y1 - y0_ + 2 * kMargin;
    // The area bounds the cell of a broad world, the length that of a world which is one thin line.
    cell_ = std::max({kCell, std::sqrt(width * height / kMaxCells), (width + height) / kMaxCells});
    columns_ = static_cast<std::int64_t>(width / cell_) + 1;
    rows_ = static_cast<std::int64_t>(height / cell_) + 1;

    std::vector<std::vector<std::size_t>> touched(count);
    starts_.assign(static_cast<std::size_t>(columns_ * rows_) + 1, 0);
    for (std::size_t i = 0; i < count; ++i) {
        overlapped(segments_[i], touched[i]);
        for (std::size_t cell : touched[i]) ++starts_[cell + 1];
    }
    for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
    members_.resize(starts_.back());
    std::vector<std::size_t> next(starts_.begin(), starts_.end() - 1);
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t cell : touched[i]) members_[next[cell]++] = static_cast<std::uint32_t>(i);
    }
}

// Row by row: the columns between the x of the segment where it enters the row and where it leaves it.
void SegmentGrid::overlapped(const Segment& s, std::vector<std::size_t>& cells) const {
    const auto clamp = [&](double v, std::int64_t n) {
        return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(v / cell_)), 0, n - 1);
    };
    const bool upward = s.y0 <= s.y1;
    const double xa = upward ? s.x0 : s.x1, ya = upward ? s.y0 : s.y1;
    const double xb = upward ? s.x1 : s.x0, yb = upward ? s.y1 : s.y0;
    const std::int64_t first = clamp(ya - kMargin - y0_, rows_), last = clamp(yb + kMargin - y0_, rows_);
    const auto x_at = [&](double y) {
        return yb > ya ? xa + (xb - xa) * std::clamp((y - ya) / (yb - ya), 0.0, 1.0) : xa;
    };
    for (std::int64_t row = first; row <= last; ++row) {
        const double low = y0_ + static_cast<double>(row) * cell_ - kMargin, high = low + cell_ + 2 * kMargin;
        double left = x_at(low), right = x_at(high);
        if (yb - ya <= 4 * kMargin) left = xa, right = xb;  // level: within the margin of one row the slope says nothing
        if (left > right) std::swap(left, right);
        const std::int64_t begin = clamp(left - kMargin - x0_, columns_), end = clamp(right + kMargin - x0_, columns_);
        for (std::int64_t column = begin; column <= end; ++column) {
            cells.push_back(static_cast<std::size_t>(row * columns_ + column));
        }
    }
}

double SegmentGrid::nearest_in_cell(std::size_t cell, double x, double y, double dx, double dy, double best) const {
    for (std::size_t k = starts_[cell]; k < starts_[cell + 1]; ++k) {
        best = std::min(best, hit(segments_[members_[k]], x, y, dx, dy));
    }
    return best;
}

double SegmentGrid::cast(double x, double y, double dx, double dy, double reach) const {
    if (segments_.empty()) return kInfinity;
    // Part of the ray inside the grid (slab method).
    double enter = 0.0, leave = reach;
    const auto clip = [&](double origin, double d, double low, double high) {
        if (d == 0.0) {
            if (origin < low || origin > high) leave = -1.0;
            return;
        }
        const double a = (low - origin) / d, b = (high - origin) / d;
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
    };
    clip(x, dx, x0_, x0_ + static_cast<double>(columns_) * cell_);
    clip(y, dy, y0_, y0_ + static_cast<double>(rows_) * cell_);
    if (enter > leave) return kInfinity;

    const auto index = [&](double v, std::int64_t n) {
        return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(v / cell_)), 0, n - 1);
    };
    std::int64_t column = index(x + enter * dx - x0_, columns_), row = index(y + enter * dy - y0_, rows_);
    const std::int64_t step_x = dx > 0 ? 1 : -1, step_y = dy > 0 ? 1 : -1;
    const auto border = [&](std::int64_t i, double d, double low, double origin) {
        return d == 0.0 ? kInfinity : (low + static_cast<double>(i + (d > 0)) * cell_ - origin) / d;
    };
    double next_x = border(column, dx, x0_, x), next_y = border(row, dy, y0_, y);
    const double per_x = dx == 0.0 ? kInfinity : cell_ / std::abs(dx), per_y = dy == 0.0 ? kInfinity : cell_ / std::abs(dy);

    double best = kInfinity;
    while (true) {
        best = nearest_in_cell(static_cast<std::size_t>(row * columns_ + column), x, y, dx, dy, best);
        const double exit = std::min(next_x, next_y);
        if (best <= exit || exit > leave) break;
        if (next_x < next_y) {
            column += step_x;
            next_x += per_x;
            if (column < 0 || column >= columns_) break;
        } else {
            row += step_y;
            next_y += per_y;
            if (row < 0 || row >= rows_) break;
        }
    }
    return best < reach ? best : kInfinity;
}

void cast_scans(const SegmentGrid& grid, const double* poses, std::size_t pose_count, const double* angles,
                std::size_t angle_count, double reach, double* ranges) {
    for (std::size_t i = 0; i < pose_count; ++i) {
        const double* pose = poses + 3 * i;
        for (std::size_t k = 0; k < angle_count; ++k) {
            const double direction = pose[2] + angles[k];
            ranges[i * angle_count + k] = grid.cast(pose[0], pose[1], std::cos(direction), std::sin(direction), reach);
        }
    }
}

}  // namespace clew::sim
