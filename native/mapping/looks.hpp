// How often each place was seen occupied and seen through, over a whole log.
#pragma once

#include <cstddef>
#include <cstdint>

namespace clew::mapping {

// Scans of a log; scan s owns the beams offsets[s] to offsets[s + 1], beam i of it points at first_angle + i * increment.
struct Looks {
    const double* T_world_sensor;  // (scans, 3)
    const std::int64_t* offsets;   // (scans + 1)
    const double* first_angle;     // (scans)
    const double* increment;       // (scans)
    const double* range;           // (beams) metres; infinite where there is no return, nan where the beam is invalid
    const std::int32_t* moment;    // (scans) number of the moment that the scan belongs to
    std::size_t scans;
};

struct LookOptions {
    double resolution;  // side of a cell, metres
    double reach;       // returns from further away do not count, metres
    double free_range;  // longest free ray of a beam without return, metres
    double width;       // a ray must pass other returns of its scan at this distance, metres,
    double margin;      // and says nothing about what is nearer than this before a return, metres
    double sure;        // farther away the heading is not sure enough to say which of two things a ray met, metres
};

// `clear` (beams): how far each beam is trusted to have seen through, metres. That is as far as neither its own return
// nor one of its scan within `width` beside it comes nearer than `margin`; the returns of the next beams count at any
// distance. So a ray that grazes a wall says nothing about the wall. A beam without return is trusted no further than
// the nearest returns on either side.
void clear_lengths(const Looks& looks, const LookOptions& options, double* clear);

// What the looks at the place of every return add up to (beams); all zero for beams without return.
struct Tally {
    std::int32_t* hits;       // moments at which something was seen in its cell or one beside it,
    std::int32_t* misses;     // and at which its cell was seen through;
    std::int32_t* changes;    // how often the one followed the other,
    std::uint8_t* seen_last;  // whether a hit was the last of them,
    std::uint8_t* both_ways;  // and whether there were both along rays of one direction, to a sixteenth of a turn. What
                              // is seen through counts here up to `sure`, by beams that ended somewhere
};

void count_looks(const Looks& looks, const LookOptions& options, const double* clear, const Tally& tally);

}  // namespace clew::mapping
