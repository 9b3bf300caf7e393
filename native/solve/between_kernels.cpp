// Relative poses: e = [R_z^T (R_i^T (t_j - t_i) - t_z), Log(R_z^T R_i^T R_j)], tangents of the decoupled retract
// t <- t + R v, R <- R Exp(w). A prior is the same with an identity held constant in the place of pose i.
#include "solve/rotation.hpp"
#include "solve/scatter.hpp"

namespace clew::CLEW_ISA {
namespace {

struct BetweenSE2 {
    const Block& block;
    const double* from;
    const double* to;

    template <bool full>
    void evaluate(int64_t m, double* e, double* ji, double* jj) const {
        const double* a = from + 3 * block.rows[2 * m];
        const double* b = to + 3 * block.rows[2 * m + 1];
        const double* z = block.measurement + 3 * m;
        const double ci = cos(a[2]), si = sin(a[2]), cz = cos(z[2]), sz = sin(z[2]);
        const double dx = b[0] - a[0], dy = b[1] - a[1];
        const double px = ci * dx + si * dy, py = ci * dy - si * dx;  // t_j seen from pose i
        const double ux = px - z[0], uy = py - z[1];
        e[0] = cz * ux + sz * uy;
        e[1] = cz * uy - sz * ux;
        const double angle = b[2] - a[2] - z[2];
        e[2] = wrap(angle);
        if (full) {
            const double c = cos(angle), s = sin(angle);
            const double i_[9] = {-cz, -sz, cz * py - sz * px, sz, -cz, -sz * py - cz * px, 0, 0, -1};
            const double j_[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
            for (int k = 0; k < 9; ++k) {
                ji[k] = i_[k];
                jj[k] = j_[k];
            }
        }
    }
};

struct BetweenSE3 {
    const Block& block;
    const double* from;
    const double* to;

    template <bool full>
    void evaluate(int64_t m, double* e, double* ji, double* jj) const {
        const double* a = from + 7 * block.rows[2 * m];
        const double* b = to + 7 * block.rows[2 * m + 1];
        const double* z = block.measurement + 7 * m;
        double ra[9], rz[9], p[3], u[3], relative[4], error[4];
        matrix(a + 3, ra);
        matrix(z + 3, rz);
        const double d[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
        transposed_times(ra, d, p);  // t_j seen from pose i
        for (int k = 0; k < 3; ++k) u[k] = p[k] - z[k];
        transposed_times(rz, u, e);
        conjugate_times(a + 3, b + 3, relative);
        conjugate_times(z + 3, relative, error);
        const double c = log_quaternion(error, e + 3);
        if (full) {
            double rij[9], re[9], jr[9];
            matrix(relative, rij);
            matrix(error, re);
            right_jacobian_inverse(e + 3, c, jr);
            for (int r = 0; r < 3; ++r) {
                const double x = rz[r], y = rz[3 + r], w = rz[6 + r];  // row r of R_z^T
                ji[6 * r + 0] = -x;
                ji[6 * r + 1] = -y;
                ji[6 * r + 2] = -w;
                ji[6 * r + 3] = y * p[2] - w * p[1];  // row r of R_z^T [p]
                ji[6 * r + 4] = w * p[0] - x * p[2];
                ji[6 * r + 5] = x * p[1] - y * p[0];
                for (int k = 0; k < 3; ++k) {
                    jj[6 * r + k] = re[3 * r + k];
                    jj[6 * r + 3 + k] = 0.0;
                    ji[6 * (r + 3) + k] = 0.0;
                    jj[6 * (r + 3) + k] = 0.0;
                    ji[6 * (r + 3) + 3 + k] = -(jr[3 * r] * rij[3 * k] + jr[3 * r + 1] * rij[3 * k + 1] +
                                                jr[3 * r + 2] * rij[3 * k + 2]);
                    jj[6 * (r + 3) + 3 + k] = jr[3 * r + k];
                }
            }
        }
    }
};

}  // namespace

double between_se2(const Block& block, const double* from, const double* to) {
    return linearise<3, 3, 3>(block, BetweenSE2{block, from, to});
}

double between_se3(const Block& block, const double* from, const double* to) {
    return linearise<6, 6, 6>(block, BetweenSE3{block, from, to});
}

}  // namespace clew::CLEW_ISA
