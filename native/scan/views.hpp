// Plain views that the kernels of this room share; the binding checks shapes and builds them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace clew::scan {

struct Pose {
    double x, y, theta;
};

// A point as a search for partners reads it, all in one place.
struct Entry {
    double x, y;
    double nx, ny;  // unit normal, towards the side from which the surface was seen
    double along;   // weight of the tangential direction, 0 for a line, 1 for a blob
};
constexpr std::size_t entry_columns = sizeof(Entry) / sizeof(double);

// Points sorted into square buckets: bucket b of the grid holds entries[starts[b]] .. entries[starts[b + 1] - 1].
struct PointIndexView {
    const Entry* entries;
    const std::int32_t* starts;
    double origin_x, origin_y, cell;
    std::int32_t width, height;
};

// The largest whole number not above `v`, which must fit; std::floor is a call where the baseline has no instruction.
template <typename Integer>
inline Integer floor_to(double v) {
    const auto cut = static_cast<Integer>(v);
    return cut - static_cast<Integer>(v < static_cast<double>(cut));
}

inline double wrap(double angle) { return std::remainder(angle, 6.283185307179586476925286766559); }

}  // namespace clew::scan
