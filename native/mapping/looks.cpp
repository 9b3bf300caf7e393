#include "looks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <unordered_map>
#include <vector>

namespace clew::mapping {

namespace {

constexpr int side_bits = 6;
constexpr std::int64_t side = 1 << side_bits;

struct Count {
    std::uint16_t hits = 0, misses = 0;
    std::int32_t hit_moment = -1, miss_moment = -1;  // the last ones that were counted
    std::uint16_t changes = 0;                        // from seen to seen through and back
    std::uint16_t hit_sides = 0, miss_sides = 0;      // directions of rays, a bit for each sixteenth of a turn
    bool was_hit = false;                             // the last time
};

using Tile = std::array<Count, side * side>;

// Cells of the infinite grid, kept in tiles that come into being where they are touched: memory grows with the area
// that was seen, not with the box around it.
class TiledGrid {
public:
    Count& at(std::int64_t col, std::int64_t row) {
        const std::int64_t tile_col = col >> side_bits, tile_row = row >> side_bits;
        if (tile_col != col_ || tile_row != row_ || tile_ == nullptr) find(tile_col, tile_row);
        return (*tile_)[static_cast<std::size_t>(((row & (side - 1)) << side_bits) | (col & (side - 1)))];
    }

private:
    void find(std::int64_t tile_col, std::int64_t tile_row) {
        const auto key = (static_cast<std::uint64_t>(static_cast<std::uint32_t>(tile_row)) << 32) |
                         static_cast<std::uint32_t>(tile_col);
        std::unique_ptr<Tile>& slot = tiles_[key];
        if (slot == nullptr) slot = std::make_unique<Tile>();
        tile_ = slot.get();
        col_ = tile_col;
        row_ = tile_row;
    }

    std::unordered_map<std::uint64_t, std::unique_ptr<Tile>> tiles_;
    Tile* tile_ = nullptr;  // the last one: neighbouring cells mostly lie in the same tile
    std::int64_t col_ = 0, row_ = 0;
};

void raise(std::uint16_t& count) {
    if (count != std::numeric_limits<std::uint16_t>::max()) ++count;
}

std::int64_t cell_of(double v) { return static_cast<std::int64_t>(std::floor(v)); }

void note(Count& count, bool is_hit) {
    if (count.was_hit != is_hit && count.hits + count.misses > 0) raise(count.changes);
    count.was_hit = is_hit;
}

std::uint16_t side_of(double angle) {
    constexpr double sides = 16;
    const double turns = angle / (2 * std::numbers::pi);
    return static_cast<std::uint16_t>(1U << static_cast<unsigned>((turns - std::floor(turns)) * (sides - 1e-9)));
}

void add_hit(TiledGrid& grid, double x, double y, std::uint16_t side, std::int32_t moment) {
    const std::int64_t col = cell_of(x), row = cell_of(y);
    for (std::int64_t dr = -1; dr <= 1; ++dr) {
        for (std::int64_t dc = -1; dc <= 1; ++dc) {
            Count& count = grid.at(col + dc, row + dr);
            count.hit_sides |= side;
            if (count.hit_moment == moment) continue;
            note(count, true);
            count.hit_moment = moment;
            raise(count.hits);
        }
    }
}

void add_misses(TiledGrid& grid, double x0, double y0, double x1, double y1, std::uint16_t side,
                std::int32_t moment) {
    // Exact traversal (Amanatides & Woo, Eurographics 1987) with a number of steps that is known beforehand.
    const double infinity = std::numeric_limits<double>::infinity();
    const double dx = x1 - x0, dy = y1 - y0;
    std::int64_t col = cell_of(x0), row = cell_of(y0);
    std::int64_t left_x = std::abs(cell_of(x1) - col), left_y = std::abs(cell_of(y1) - row);
    const std::int64_t step_x = dx > 0 ? 1 : -1, step_y = dy > 0 ? 1 : -1;
    const double per_x = dx != 0 ? 1 / std::abs(dx) : infinity, per_y = dy != 0 ? 1 / std::abs(dy) : infinity;
    double next_x = dx != 0 ? (dx > 0 ? std::floor(x0) + 1 - x0 : x0 - std::floor(x0)) * per_x : infinity;
    double next_y = dy != 0 ? (dy > 0 ? std::floor(y0) + 1 - y0 : y0 - std::floor(y0)) * per_y : infinity;
    while (true) {
        Count& count = grid.at(col, row);
        count.miss_sides |= side;
        if (count.miss_moment != moment) {
            note(count, false);
            count.miss_moment = moment;
            raise(count.misses);
        }
        if (left_x == 0 && left_y == 0) return;
        if (left_y == 0 || (left_x > 0 && next_x < next_y)) {
            --left_x;
            next_x += per_x;
            col += step_x;
        } else {
            --left_y;
            next_y += per_y;
            row += step_y;
        }
    }
}

// Where a ray may begin: up close neighbouring rays run through the same cells, so that every second, fourth, ... ray
// is enough there. A beam with index `i` begins where the beams that serve all nearer places lie half a cell apart.
double beginning(std::int64_t i, double increment) {
    if (i == 0) return 0.0;
    const double spread = std::abs(increment) * static_cast<double>(std::int64_t{2} * (i & -i));
    return 0.5 / spread;  // cells
}

}  // namespace

void clear_lengths(const Looks& looks, const LookOptions& o, double* clear) {
    for (std::size_t s = 0; s < looks.scans; ++s) {
        const std::int64_t begin = looks.offsets[s], end = looks.offsets[s + 1];
        const double* range = looks.range;
        double before = o.free_range;
        for (std::int64_t b = begin; b < end; ++b) {
            if (std::isfinite(range[b])) before = range[b];
            clear[b] = std::isnan(range[b]) ? 0.0 : std::min({before, o.reach, std::isinf(range[b]) ? o.free_range : o.reach});
        }
        double after = o.free_range;
        for (std::int64_t b = end; b-- > begin;) {
            if (std::isfinite(range[b])) after = range[b];
            clear[b] = std::min(clear[b], after);
        }
        const double per_beam = std::abs(looks.increment[s]), all = static_cast<double>(end - begin);
        for (std::int64_t b = begin; b < end; ++b) {
            if (!std::isfinite(range[b])) continue;
            const double near = std::max(range[b] - o.margin, 0.0);
            const double spread = per_beam * near;  // of neighbouring beams at that distance
            const auto beside = static_cast<std::int64_t>(spread * all > o.width ? std::max(o.width / spread, 1.0) : all);
            for (std::int64_t k = std::max(begin, b - beside); k < std::min(end, b + beside + 1); ++k) {
                clear[k] = std::min(clear[k], near);
            }
        }
    }
}

void count_looks(const Looks& looks, const LookOptions& o, const double* clear, const Tally& tally) {
    TiledGrid grid;
    const double scale = 1.0 / o.resolution;
    const auto each_beam = [&](const auto& visit) {
        for (std::size_t s = 0; s < looks.scans; ++s) {
            const double* pose = looks.T_world_sensor + 3 * s;
            const std::int64_t begin = looks.offsets[s];
            for (std::int64_t b = begin; b < looks.offsets[s + 1]; ++b) {
                const double angle = pose[2] + looks.first_angle[s] + static_cast<double>(b - begin) * looks.increment[s];
                visit(s, b, pose[0] * scale, pose[1] * scale, angle, std::cos(angle) * scale, std::sin(angle) * scale);
            }
        }
    };
    each_beam([&](std::size_t s, std::int64_t b, double x, double y, double angle, double dx, double dy) {
        const double range = looks.range[b], to = clear[b];
        const std::uint16_t side = std::isfinite(range) ? side_of(angle) : 0;
        if (range <= o.reach) add_hit(grid, x + range * dx, y + range * dy, side, looks.moment[s]);
        const double from = o.resolution * beginning(b - looks.offsets[s], looks.increment[s]);
        const double near = std::clamp(to, from, std::max(from, o.sure));
        if (from < near) add_misses(grid, x + from * dx, y + from * dy, x + near * dx, y + near * dy, side, looks.moment[s]);
        if (near < to) add_misses(grid, x + near * dx, y + near * dy, x + to * dx, y + to * dy, 0, looks.moment[s]);
    });
    each_beam([&](std::size_t, std::int64_t b, double x, double y, double, double dx, double dy) {
        Count none;
        const double range = looks.range[b];
        const Count& count = range <= o.reach ? grid.at(cell_of(x + range * dx), cell_of(y + range * dy)) : none;
        tally.hits[b] = count.hits;
        tally.misses[b] = count.misses;
        tally.changes[b] = count.changes;
        tally.seen_last[b] = count.was_hit ? 1 : 0;
        tally.both_ways[b] = (count.hit_sides & count.miss_sides) != 0 ? 1 : 0;
    });
}

}  // namespace clew::mapping
