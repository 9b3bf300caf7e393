// Ray casting of laser scans into a grid of counts.
#pragma once

#include <cstddef>
#include <cstdint>

namespace clew::mapping {

// What a cell has seen. Counts stop at 65,535. `stamp` is the number of the last scan that touched the cell.
struct Cell {
    std::uint16_t hits;
    std::uint16_t misses;
    std::uint16_t stamp;
};
static_assert(sizeof(Cell) == 6, "the cells are a uint16 array (rows, cols, 3) on the Python side");

// A dense window of the infinite grid whose cell (col, row) covers [col, col + 1) x [row, row + 1) times the resolution.
struct Window {
    Cell* cells;  // row-major
    std::int64_t rows, cols;
    std::int64_t first_row, first_col;
    double resolution;
};

// Rays of `scans` scans; scan s owns the beams offsets[s] to offsets[s + 1].
struct Rays {
    const double* T_world_sensor;  // (scans, 3)
    const std::int64_t* offsets;   // (scans + 1)
    const double* endpoints;       // (beams, 2), sensor frame
    const bool* hit;               // (beams); false: free up to the endpoint, and nothing known there
    std::size_t scans;
};

// Count hits and misses of all rays; each scan touches a cell at most once and a hit wins over a miss.
// The part of a ray from `margin` metres before its hit on is not counted as a miss. `stamp` is the number of
// the last scan cast into the window so far; returns the new one.
std::uint16_t cast(const Window& window, const Rays& rays, double margin, std::uint16_t stamp);

// Smallest box around the sensors and all endpoints in the world: min x, min y, max x, max y.
void bounds(const Rays& rays, double box[4]);

}  // namespace clew::mapping
