// Poses along a tree of relative poses: x_child = x_parent z, or x_parent z^-1 against the edge's direction.
#include <math.h>

#include "solve/block.hpp"
#include "solve/rotation.hpp"

namespace clew::CLEW_ISA {

void compose_tree_se2(int64_t count, const int64_t* node, const int64_t* parent, const int64_t* edge,
                      const uint8_t* forward, const double* measurement, double* values) {
    for (int64_t n = 0; n < count; ++n) {
        if (parent[n] < 0) continue;
        const double* a = values + 3 * parent[n];
        const double* z = measurement + 3 * edge[n];
        double* b = values + 3 * node[n];
        const double theta = wrap(forward[n] ? a[2] + z[2] : a[2] - z[2]);
        const double angle = forward[n] ? a[2] : theta;
        const double sign = forward[n] ? 1.0 : -1.0;  // t_child = t_parent + R_parent t_z, or - R_child t_z
        const double c = sign * cos(angle), s = sign * sin(angle);
        b[0] = a[0] + c * z[0] - s * z[1];
        b[1] = a[1] + s * z[0] + c * z[1];
        b[2] = theta;
    }
}

void compose_tree_se3(int64_t count, const int64_t* node, const int64_t* parent, const int64_t* edge,
                      const uint8_t* forward, const double* measurement, double* values) {
    for (int64_t n = 0; n < count; ++n) {
        if (parent[n] < 0) continue;
        const double* a = values + 7 * parent[n];
        const double* z = measurement + 7 * edge[n];
        double* b = values + 7 * node[n];
        double q[4], r[9];
        if (forward[n]) {
            times(a + 3, z + 3, q);
        } else {
            const double back[4] = {-z[3], -z[4], -z[5], z[6]};
            times(a + 3, back, q);
        }
        double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        if (q[3] < 0) length = -length;
        for (int k = 0; k < 4; ++k) q[k] /= length;
        matrix(forward[n] ? a + 3 : q, r);
        const double sign = forward[n] ? 1.0 : -1.0;
        for (int k = 0; k < 3; ++k)
            b[k] = a[k] + sign * (r[3 * k] * z[0] + r[3 * k + 1] * z[1] + r[3 * k + 2] * z[2]);
        for (int k = 0; k < 4; ++k) b[3 + k] = q[k];
    }
}

}  // namespace clew::CLEW_ISA
