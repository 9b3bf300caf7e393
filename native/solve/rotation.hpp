// Angles, unit quaternions (x, y, z, w) and 3x3 rotations on plain arrays; included by *_kernels.cpp only.
#pragma once

#include <math.h>

namespace clew::CLEW_ISA {
namespace {

// Angle in (-pi, pi].
inline double wrap(double angle) {
    constexpr double pi = 3.14159265358979323846;
    return angle > pi || angle <= -pi ? angle - 2.0 * pi * ceil((angle - pi) / (2.0 * pi)) : angle;
}

// out = conj(a) b
inline void conjugate_times(const double* a, const double* b, double* out) {
    out[0] = a[3] * b[0] - b[3] * a[0] - (a[1] * b[2] - a[2] * b[1]);
    out[1] = a[3] * b[1] - b[3] * a[1] - (a[2] * b[0] - a[0] * b[2]);
    out[2] = a[3] * b[2] - b[3] * a[2] - (a[0] * b[1] - a[1] * b[0]);
    out[3] = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// out = a b
inline void times(const double* a, const double* b, double* out) {
    out[0] = a[3] * b[0] + b[3] * a[0] + (a[1] * b[2] - a[2] * b[1]);
    out[1] = a[3] * b[1] + b[3] * a[1] + (a[2] * b[0] - a[0] * b[2]);
    out[2] = a[3] * b[2] + b[3] * a[2] + (a[0] * b[1] - a[1] * b[0]);
    out[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

// Row-major matrix of a unit quaternion.
inline void matrix(const double* q, double* r) {
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    r[0] = 1 - 2 * (y * y + z * z); r[1] = 2 * (x * y - z * w);     r[2] = 2 * (x * z + y * w);
    r[3] = 2 * (x * y + z * w);     r[4] = 1 - 2 * (x * x + z * z); r[5] = 2 * (y * z - x * w);
    r[6] = 2 * (x * z - y * w);     r[7] = 2 * (y * z + x * w);     r[8] = 1 - 2 * (x * x + y * y);
}

// out = R^T v
inline void transposed_times(const double* r, const double* v, double* out) {
    for (int i = 0; i < 3; ++i) out[i] = r[i] * v[0] + r[3 + i] * v[1] + r[6 + i] * v[2];
}

// Rotation vector of a unit quaternion, and c in Jr^-1(v) = I + [v]/2 + c [v]^2 (Sola et al. 2018, eq. 144).
inline double log_quaternion(const double* q, double* v) {
    const double sign = q[3] < 0 ? -1.0 : 1.0;
    const double w = sign * q[3];
    const double sine2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2];
    double factor, c;
    if (sine2 < 1e-8) {
        // atan(u) / u with u = sine / w, to the order u^4; angle^2 < 4e-8
        const double u2 = sine2 / (w * w);
        factor = 2.0 / w * (1.0 - u2 / 3.0 + u2 * u2 / 5.0);
        c = 1.0 / 12.0 + factor * factor * sine2 / 720.0;
    } else {
        const double sine = sqrt(sine2);
        const double half = atan2(sine, w);
        factor = 2.0 * half / sine;
        c = (1.0 - half * w / sine) / (4.0 * half * half);
    }
    factor *= sign;
    for (int i = 0; i < 3; ++i) v[i] = factor * q[i];
    return c;
}

// Jr^-1(v) with c of log_quaternion, row-major.
inline void right_jacobian_inverse(const double* v, double c, double* out) {
    const double x = v[0], y = v[1], z = v[2];
    const double d = 1.0 - c * (x * x + y * y + z * z);  // [v]^2 = v v^T - |v|^2 I
    out[0] = d + c * x * x;       out[1] = c * x * y - 0.5 * z; out[2] = c * x * z + 0.5 * y;
    out[3] = c * x * y + 0.5 * z; out[4] = d + c * y * y;       out[5] = c * y * z - 0.5 * x;
    out[6] = c * x * z - 0.5 * y; out[7] = c * y * z + 0.5 * x; out[8] = d + c * z * z;
}

}  // namespace
}  // namespace clew::CLEW_ISA
