// Surface normals of a scan, in the order of its beams.
#pragma once

#include <cstddef>
#include <cstdint>

namespace clew::scan {

struct SurfaceOptions {
    std::int32_t window;   // neighbours looked at on each side at most
    double radius;         // metres; neighbours further than this do not count, unless they are the nearest two
    double gap_base;       // metres; a step between neighbours longer than
    double gap_per_metre;  //   gap_base + gap_per_metre * range ends the surface
};

// points (n, 2) in the sensor frame, in the order of beams; beams (n,) their indices. Writes unit normals that look
// at the sensor, the ratio of minor to major deviation of the neighbourhood, and the number of neighbours that made
// the normal (0: isolated).
void surface_normals(const double* points, const std::int32_t* beams, std::size_t n, const SurfaceOptions& options,
                     double* normals, double* ratio, std::int32_t* support);

}  // namespace clew::scan
