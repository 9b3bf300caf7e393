// Rotations nearest to matrices, for initial guesses that solve for rotations as if they were any matrices.
#pragma once

#include <cstdint>

namespace clew::solve {

// Unit quaternions (count, 4), x y z w with w >= 0, of the rotations R nearest to the matrices M (count, 3, 3),
// row-major, in the Frobenius norm. Any of the nearest where there are several; the identity for zero and for what is
// not finite.
void nearest_rotations(int64_t count, const double* matrices, double* quaternions);

}  // namespace clew::solve
