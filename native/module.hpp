#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace clew {

namespace nb = nanobind;

void bind_isa(nb::module_ m);
void bind_linalg(nb::module_ m);
void bind_solve(nb::module_ m);
void bind_scan(nb::module_ m);
void bind_mapping(nb::module_ m);
void bind_io(nb::module_ m);
void bind_sim(nb::module_ m);

}  // namespace clew
