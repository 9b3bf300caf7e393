// The matrix product, for the other *_kernels.cpp of the same instruction set.
#pragma once

#include "linalg/dense.hpp"

namespace clew::CLEW_ISA {

void multiply(const linalg::Multiply& m, double* scratch);

}  // namespace clew::CLEW_ISA
