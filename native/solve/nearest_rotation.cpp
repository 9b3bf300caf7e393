#include "solve/nearest_rotation.hpp"

#include <algorithm>
#include <cmath>

namespace clew::solve {

namespace {

// Eigenvector of the largest eigenvalue of a symmetric matrix, by Jacobi's cyclic rotations (Golub and Van Loan,
// "Matrix Computations", 2013, section 8.5), which lose nothing where eigenvalues lie close together.
void leading_eigenvector(double a[4][4], double* out) {
    double v[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    constexpr int kSweeps = 12;  // four or five do
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
        double off = 0, diagonal = 0;
        for (int p = 0; p < 4; ++p) {
            diagonal += a[p][p] * a[p][p];
            for (int q = p + 1; q < 4; ++q) off += a[p][q] * a[p][q];
        }
        if (off <= 1e-32 * diagonal) break;
        for (int p = 0; p < 3; ++p) {
            for (int q = p + 1; q < 4; ++q) {
                if (a[p][q] == 0) continue;
                const double tau = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                const double t = std::copysign(1.0, tau) / (std::abs(tau) + std::sqrt(1 + tau * tau));
                const double c = 1 / std::sqrt(1 + t * t), s = t * c;
                for (int k = 0; k < 4; ++k) {
                    const double kp = a[k][p], kq = a[k][q];
                    a[k][p] = c * kp - s * kq;
                    a[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 4; ++k) {
                    const double pk = a[p][k], qk = a[q][k];
                    a[p][k] = c * pk - s * qk;
                    a[q][k] = s * pk + c * qk;
                }
                for (int k = 0; k < 4; ++k) {
                    const double kp = v[k][p], kq = v[k][q];
                    v[k][p] = c * kp - s * kq;
                    v[k][q] = s * kp + c * kq;
                }
            }
        }
    }
    int best = 0;
    for (int p = 1; p < 4; ++p) {
        if (a[p][p] > a[best][best]) best = p;
    }
    for (int k = 0; k < 4; ++k) out[k] = v[k][best];
}

}  // namespace

// The nearest rotation has the largest trace(R^T M), which is q^T N q in its quaternion (Horn, "Closed-form solution of
// absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4, 1987).
void nearest_rotations(int64_t count, const double* matrices, double* quaternions) {
    for (int64_t n = 0; n < count; ++n) {
        double m[9];
        double* q = quaternions + 4 * n;
        double largest = 0;
        bool finite = true;
        for (int k = 0; k < 9; ++k) {
            m[k] = matrices[9 * n + k];
            largest = std::max(largest, std::abs(m[k]));
            finite &= std::isfinite(m[k]);
        }
        if (!finite || largest == 0) {
            std::fill_n(q, 3, 0.0);
            q[3] = 1;
            continue;
        }
        for (double& entry : m) entry /= largest;  // squares of the smallest numbers would vanish
        const double trace = m[0] + m[4] + m[8];
        const double x = m[7] - m[5], y = m[2] - m[6], z = m[3] - m[1];
        double horn[4][4] = {{2 * m[0] - trace, m[1] + m[3], m[2] + m[6], x},
                             {m[1] + m[3], 2 * m[4] - trace, m[5] + m[7], y},
                             {m[2] + m[6], m[5] + m[7], 2 * m[8] - trace, z},
                             {x, y, z, trace}};
        leading_eigenvector(horn, q);
        const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        const double scale = (q[3] < 0 ? -1.0 : 1.0) / norm;
        for (int k = 0; k < 4; ++k) q[k] *= scale;
    }
}

}  // namespace clew::solve
