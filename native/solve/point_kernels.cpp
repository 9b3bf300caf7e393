// Landmarks seen from a pose: q = R_s^T (R^T (p - t) - t_s) is the point in the sensor's frame, with the sensor's
// constant pose (t_s, R_s) on the robot (null: the identity). Point: e = q - z. Range and bearing in the plane:
// e = [|q| - r, wrap(atan2(q_y, q_x) - b)].
#include "solve/rotation.hpp"
#include "solve/scatter.hpp"

namespace clew::CLEW_ISA {
namespace {

struct SensorSE2 {
    double x = 0, y = 0, c = 1, s = 0;

    explicit SensorSE2(const double* pose) {
        if (pose) {
            x = pose[0];
            y = pose[1];
            c = cos(pose[2]);
            s = sin(pose[2]);
        }
    }
};

// Point in the sensor's frame q (2), its derivatives by pose (2, 3) and point (2, 2).
template <bool full>
inline void see(const double* pose, const double* point, const SensorSE2& sensor, double* q, double* jpose,
                double* jpoint) {
    const double c = cos(pose[2]), s = sin(pose[2]);
    const double dx = point[0] - pose[0], dy = point[1] - pose[1];
    const double px = c * dx + s * dy, py = c * dy - s * dx;  // in the robot's frame
    const double ux = px - sensor.x, uy = py - sensor.y;
    q[0] = sensor.c * ux + sensor.s * uy;
    q[1] = sensor.c * uy - sensor.s * ux;
    if (full) {
        const double cc = sensor.c, ss = sensor.s;
        jpose[0] = -cc; jpose[1] = -ss; jpose[2] = cc * py - ss * px;
        jpose[3] = ss;  jpose[4] = -cc; jpose[5] = -ss * py - cc * px;
        jpoint[0] = cc * c - ss * s; jpoint[1] = cc * s + ss * c;
        jpoint[2] = -jpoint[1];      jpoint[3] = jpoint[0];
    }
}

struct PointSE2 {
    const Block& block;
    const double* poses;
    const double* points;
    SensorSE2 sensor;

    template <bool full>
    void evaluate(int64_t m, double* e, double* jpose, double* jpoint) const {
        see<full>(poses + 3 * block.rows[2 * m], points + 2 * block.rows[2 * m + 1], sensor, e, jpose, jpoint);
        for (int k = 0; k < 2; ++k) e[k] -= block.measurement[2 * m + k];
    }
};

struct RangeBearingSE2 {
    const Block& block;
    const double* poses;
    const double* points;
    SensorSE2 sensor;

    template <bool full>
    void evaluate(int64_t m, double* e, double* jpose, double* jpoint) const {
        double q[2], a[6], b[4];
        see<full>(poses + 3 * block.rows[2 * m], points + 2 * block.rows[2 * m + 1], sensor, q, a, b);
        const double range = sqrt(q[0] * q[0] + q[1] * q[1]);
        e[0] = range - block.measurement[2 * m];
        const double angle = atan2(q[1], q[0]) - block.measurement[2 * m + 1];
        e[1] = wrap(angle);
        if (full) {
            const double r = range > 1e-12 ? range : 1e-12;  // a point on the sensor has no bearing
            const double ux = q[0] / r, uy = q[1] / r;
            for (int k = 0; k < 3; ++k) {
                jpose[k] = ux * a[k] + uy * a[3 + k];
                jpose[3 + k] = (ux * a[3 + k] - uy * a[k]) / r;
            }
            for (int k = 0; k < 2; ++k) {
                jpoint[k] = ux * b[k] + uy * b[2 + k];
                jpoint[2 + k] = (ux * b[2 + k] - uy * b[k]) / r;
            }
        }
    }
};

struct PointSE3 {
    const Block& block;
    const double* poses;
    const double* points;
    double offset[3] = {0, 0, 0};
    double turn[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // R_s

    PointSE3(const Block& b, const double* poses_, const double* points_, const double* sensor)
        : block(b), poses(poses_), points(points_) {
        if (sensor) {
            for (int k = 0; k < 3; ++k) offset[k] = sensor[k];
            matrix(sensor + 3, turn);
        }
    }

    template <bool full>
    void evaluate(int64_t m, double* e, double* jpose, double* jpoint) const {
        const double* pose = poses + 7 * block.rows[2 * m];
        const double* point = points + 3 * block.rows[2 * m + 1];
        double r[9], p[3], u[3];
        matrix(pose + 3, r);
        const double d[3] = {point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]};
        transposed_times(r, d, p);  // in the robot's frame
        for (int k = 0; k < 3; ++k) u[k] = p[k] - offset[k];
        transposed_times(turn, u, e);
        for (int k = 0; k < 3; ++k) e[k] -= block.measurement[3 * m + k];
        if (full) {
            for (int k = 0; k < 3; ++k) {
                const double x = turn[k], y = turn[3 + k], w = turn[6 + k];  // row k of R_s^T
                jpose[6 * k + 0] = -x;
                jpose[6 * k + 1] = -y;
                jpose[6 * k + 2] = -w;
                jpose[6 * k + 3] = y * p[2] - w * p[1];  // row k of R_s^T [p]
                jpose[6 * k + 4] = w * p[0] - x * p[2];
                jpose[6 * k + 5] = x * p[1] - y * p[0];
                for (int i = 0; i < 3; ++i)  // R_s^T R^T
                    jpoint[3 * k + i] = x * r[3 * i] + y * r[3 * i + 1] + w * r[3 * i + 2];
            }
        }
    }
};

}  // namespace

double point_observation_2d(const Block& block, const double* poses, const double* points, const double* sensor) {
    return linearise<2, 3, 2>(block, PointSE2{block, poses, points, SensorSE2(sensor)});
}

double range_bearing_2d(const Block& block, const double* poses, const double* points, const double* sensor) {
    return linearise<2, 3, 2>(block, RangeBearingSE2{block, poses, points, SensorSE2(sensor)});
}

double point_observation_3d(const Block& block, const double* poses, const double* points, const double* sensor) {
    return linearise<3, 6, 3>(block, PointSE3(block, poses, points, sensor));
}

}  // namespace clew::CLEW_ISA
