// Storage of update matrices: the lower triangle in panels of columns, so that little more than half of the square is
// held while fronts wait for their parents.
#pragma once

#include <cstdint>

namespace clew::linalg {

// Panel b holds columns [64 b, 64 b + 64) from row 64 b on, column-major with leading dimension `ld - 64 b`, panels one
// after the other. `ld` is that of the front's update rows (`Front::ld_b`).
constexpr int32_t kPanelColumns = 64;

// Start of panel b.
constexpr int64_t panel_start(int32_t b, int64_t ld) {
    return int64_t{kPanelColumns} * b * ld - int64_t{kPanelColumns} * kPanelColumns / 2 * b * (b - int64_t{1});
}

// Where row 0 of a column would be: rows from the panel's first on may be read and written.
constexpr int64_t column_start(int32_t column, int64_t ld) {
    const int32_t b = column / kPanelColumns, top = b * kPanelColumns;
    return panel_start(b, ld) + (column - top) * (ld - top) - top;
}

// Doubles of a whole update matrix.
constexpr int64_t update_matrix_size(int32_t rows, int64_t ld) {
    const int32_t b = rows / kPanelColumns, top = b * kPanelColumns;
    return panel_start(b, ld) + (rows - top) * (ld - top);
}

}  // namespace clew::linalg
