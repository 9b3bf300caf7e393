// Returns against what other scans saw: where they saw something too, and where they saw through.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.hpp"

namespace clew::mapping {

// A sensor's beams: the pose of the points' frame seen from it, the direction of the middle beam, beams a radian (negative
// where they turn right), and the number of the middle beam.
struct Beams {
    double x, y, cosine, sine, middle, per_beam, half;
};

// What scans saw; view v owns the beams offsets[v] to offsets[v + 1], beam i of it points at first_angle + i * increment.
struct Views {
    const double* T_sensor_points;  // (views, 3) pose of the points' frame seen from each sensor
    const std::int64_t* offsets;    // (views + 1)
    const double* first_angle;      // (views)
    const double* increment;        // (views) not zero
    const double* range;            // (beams) metres; anything where there is no return
    const double* clear;            // (beams) how far each beam is trusted to have seen through, metres
    std::size_t views;
};

// For every point (count, 2): how many views saw something there, that is, have a return within `slack` of its distance
// on one of the two beams beside it, and how many saw through, that is, both beams were clear farther than it. A view
// that did neither had something in the way, or the place out of sight.
void see(const Views& views, const double* points, std::size_t count, double slack, std::int32_t* seen,
         std::int32_t* through);

}  // namespace clew::mapping

// For every point (count, 2) the number of the beam that points at it, a fraction where it lies between two, and its
// distance from the sensor.
CLEW_DECLARE(void beams_at(const ::clew::mapping::Beams& sensor, const double* points, std::size_t count, double* beam,
                           double* distance);)
