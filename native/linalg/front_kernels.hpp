// Kernels that move vectors through a front, for the table in dense_kernels.cpp of the same instruction set.
#pragma once

#include "linalg/dense.hpp"

namespace clew::CLEW_ISA {

void forward(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x, double* t);
void backward(int32_t n, const double* d, int32_t rows, const double* b, int64_t ldb, double* x, const double* t);
void add_to_panel(const double* u, int64_t ldu, const linalg::Run* runs, const linalg::Run* remaining,
                  const linalg::Run* end, linalg::Columns columns, double* d, int64_t ldd, double* b, int64_t ldb);
void add_to_update(const double* u, int64_t ldu, const linalg::Run* remaining, const linalg::Run* end,
                   linalg::Columns columns, double* to, int64_t ldt);

}  // namespace clew::CLEW_ISA
