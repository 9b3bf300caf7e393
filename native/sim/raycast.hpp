// Ray casting of planar laser scans against line segments.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace clew::sim {

struct Segment {
    double x0, y0, x1, y1;
};

// A uniform grid over the segments: each cell lists the segments that touch it, a little more generously than exactly,
// so that rounding never hides a segment from a ray that grazes the border of a cell.
class SegmentGrid {
   public:
    SegmentGrid(const double* segments, std::size_t count);

    // Distance to the nearest segment along the unit direction (dx, dy), or infinity where none is nearer than `reach`.
    double cast(double x, double y, double dx, double dy, double reach) const;

   private:
    void overlapped(const Segment& s, std::vector<std::size_t>& cells) const;
    double nearest_in_cell(std::size_t cell, double x, double y, double dx, double dy, double best) const;

    std::vector<Segment> segments_;
    std::vector<std::size_t> starts_;    // of each cell in `members_`
    std::vector<std::uint32_t> members_;  // indices of segments, cell by cell
    double x0_ = 0, y0_ = 0, cell_ = 1;
    std::int64_t columns_ = 0, rows_ = 0;
};

// ranges (poses, angles): distance from each pose (x, y, theta) in the direction theta + angle; infinity for no hit.
void cast_scans(const SegmentGrid& grid, const double* poses, std::size_t pose_count, const double* angles,
                std::size_t angle_count, double reach, double* ranges);

}  // namespace clew::sim
