// From the ranges of one scan to points with normals, and to surfaces that others are matched against.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "surface.hpp"
#include "views.hpp"

namespace clew::scan {

// Points (n, 2) with unit normals (n, 2), how much they hold along their surface (n,), and weights (n,).
struct Cloud {
    std::vector<double> points, normals, along, weights;
};

struct CloudView {
    const double *points, *normals, *along, *weights;
    std::size_t n;
};

// Ranges and directions of a scan as it would have been measured all at once, at its timestamp: `delays` are the
// seconds after it at which each beam was measured, `velocity` is the robot's, in its own frame.
void deskew(const double* ranges, const double* angles, const double* delays, std::size_t n, const Pose& velocity,
            const Pose& T_robot_sensor, double* still_ranges, double* bearings);

struct ExtractOptions {
    double nearest, farthest;  // metres; ranges of returns
    SurfaceOptions surface;
    double blob;             // ratio of deviations from which a neighbourhood holds along its surface too
    double weight_per_metre;  // of range; the weight of a return is this, within 0.1 and 1
};

// Returns in the robot's frame, without isolated ones; `beams` receives the beam of each.
Cloud extract_returns(const double* ranges, const double* angles, std::size_t n, const Pose& T_robot_sensor,
                      const ExtractOptions& options, std::vector<std::int32_t>& beams);

struct FillOptions {
    double step;                     // metres; neighbours further apart get points between them
    double gap_base, gap_per_metre;  // where a surface ends
    double flat;                     // sine of the angle between a straight wall and the line of two returns on it
    double weight;                   // of a point put in, as a share of that of the return before it
};

// The points that belong between neighbouring returns on one straight wall.
Cloud between_returns(const CloudView& cloud, const FillOptions& options);

}  // namespace clew::scan
