// Points sorted into buckets for nearest-neighbour search.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "views.hpp"

namespace clew::scan {

// Counting sort of points into a width x height grid of cells; `starts` (width * height + 1), `entries` (n,).
void sort_into_buckets(const double* points, const double* normals, const double* along, std::size_t n, double origin_x,
                       double origin_y, double cell, std::int32_t width, std::int32_t height, std::int32_t* starts,
                       Entry* entries);

// Points that share a square of side `voxel` and look the same way become one, in order of first appearance: weighted
// means of places (m, 2) and of `along` (m,), and unit normals (m, 2) in the mean direction.
struct Surfels {
    std::vector<double> points, normals, along;
};
Surfels merge_surfels(const double* points, const double* normals, const double* along, const double* weights,
                      std::size_t n, double voxel);

}  // namespace clew::scan
