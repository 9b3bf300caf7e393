// Point-to-line alignment of scans (Censi 2008) with robust weights and a prior.
#pragma once

#include <cstddef>
#include <cstdint>

#include "views.hpp"

namespace clew::scan {

struct AlignOptions {
    double radius_start;   // metres; correspondences are sought within it at the first iteration,
    double radius_end;     //   and within this at the last ones
    double sigma;          // metres; standard deviation of a return about its surface
    double robust;         // Cauchy scale in sigmas
    double facing;         // least cosine between the two normals of a correspondence
    std::int32_t iterations;
    double correlated;     // metres; returns next to each other within it may have errors in common; 0: no push is found
};

struct AlignResult {
    Pose pose;               // T_target_source
    double information[9];   // of the data alone, tangent (x, y, theta) of the pose, row-major
    double step[3];          // Gauss-Newton step that the data alone ask for at `pose`
    double overlap;          // share of the source's points with a partner within radius_end
    double rms;              // metres; weighted residual along the normals
    double correlation;      // sum of the residuals' autocorrelation along the scan; one of independent ones
    double variance;         // metres^2; of a return, with what it has in common with its neighbours
    double push[9];          // covariance of the gradient at `pose` by the residuals, row-major,
    double spread[9];        // and were they independent with a variance of one square metre
    std::int32_t iterations;
};

// Pose of the source's points in the target's frame, from `start`, with a Gaussian prior about `prior`
// (information row-major, zero for none).
AlignResult align(const PointIndexView& target, const double* points, const double* normals, const double* weights,
                  std::size_t n, const Pose& start, const Pose& prior, const double* prior_information,
                  const AlignOptions& options);

}  // namespace clew::scan
