// Correlative scan matching: the best pose in a window, found exactly.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "views.hpp"

namespace clew::scan {

// Likelihood of a return in each cell, and its maxima over growing squares: level l holds at (x, y) the maximum over
// [x, x + 2^l) x [y, y + 2^l) of level 0. The grid has an empty margin of 2^(levels - 1) cells at least.
struct PyramidView {
    const std::uint8_t* cells;  // (levels, height, width)
    std::int32_t levels, height, width;
    double origin_x, origin_y, resolution;
};

struct SearchOptions {
    Pose centre;               // middle of the window
    double half_x, half_y;     // metres
    double half_theta;         // radians
    double step_theta;         // radians
    double prior_x, prior_y, prior_theta;  // penalty prior_weight * log(1 + 0.5 * (offset / prior)^2); infinite: none
    double prior_weight;
    double minimum_score;      // hypotheses below are of no interest
    bool exclude;              // leave out a neighbourhood (to ask for the second-best peak)
    Pose excluded;
    double exclude_distance, exclude_angle;
};

struct SearchResult {
    bool found;
    Pose pose;
    double score;       // mean likelihood in [0, 1] minus the prior's penalty
    double likelihood;  // mean likelihood alone
    std::int64_t evaluated;
};

void build_pyramid(const double* points, std::size_t n, double sigma, const PyramidView& shape, std::uint8_t* cells);

SearchResult correlate(const PyramidView& pyramid, const double* points, std::size_t n, const SearchOptions& options);

}  // namespace clew::scan
