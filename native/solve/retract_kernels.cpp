// t <- t + R v, R <- R Exp(w) for many poses; offset -1 is a pose that stays.
#include <math.h>

#include "solve/block.hpp"
#include "solve/rotation.hpp"

namespace clew::CLEW_ISA {

void retract_se2(int64_t count, const double* values, const int32_t* offsets, const double* delta, double* out) {
    for (int64_t n = 0; n < count; ++n) {
        const double* a = values + 3 * n;
        double* b = out + 3 * n;
        if (offsets[n] < 0) {
            for (int k = 0; k < 3; ++k) b[k] = a[k];
            continue;
        }
        const double* d = delta + offsets[n];
        const double c = cos(a[2]), s = sin(a[2]);
        b[0] = a[0] + c * d[0] - s * d[1];
        b[1] = a[1] + s * d[0] + c * d[1];
        b[2] = wrap(a[2] + d[2]);
    }
}

void retract_se3(int64_t count, const double* values, const int32_t* offsets, const double* delta, double* out) {
    for (int64_t n = 0; n < count; ++n) {
        const double* a = values + 7 * n;
        double* b = out + 7 * n;
        if (offsets[n] < 0) {
            for (int k = 0; k < 7; ++k) b[k] = a[k];
            continue;
        }
        const double* d = delta + offsets[n];
        double r[9];
        matrix(a + 3, r);
        for (int k = 0; k < 3; ++k) b[k] = a[k] + r[3 * k] * d[0] + r[3 * k + 1] * d[1] + r[3 * k + 2] * d[2];
        const double angle2 = d[3] * d[3] + d[4] * d[4] + d[5] * d[5];
        const double angle = sqrt(angle2);
        // sin(angle / 2) / angle, by its series near zero
        const double factor = angle2 < 1e-8 ? 0.5 - angle2 / 48.0 : sin(0.5 * angle) / angle;
        const double turn[4] = {factor * d[3], factor * d[4], factor * d[5], cos(0.5 * angle)};
        double q[4];
        times(a + 3, turn, q);
        const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        const double scale = (q[3] < 0 ? -1.0 : 1.0) / length;
        for (int k = 0; k < 4; ++k) b[3 + k] = scale * q[k];
    }
}

}  // namespace clew::CLEW_ISA
