// Gauss-Newton iterations of a pose graph in Ceres, for benchmarks/backend.py.
//
//     ceres_pose_graph FILE.g2o ITERATIONS
//
// Residuals are clew's, e = [R_z^T (R_i^T (t_j - t_i) - t_z), Log(R_z^T R_i^T R_j)], whitened, the information of
// rotations in radians; Jacobians are analytic; the first pose is held. Prints Ceres' version, the sparse library that
// was fastest, seconds of processor time for one iteration (analysis included, reading not) and chi2 at the end.
#include <ceres/ceres.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#if CERES_VERSION_MAJOR < 2 || (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR < 1)
#error "Ceres 2.1 or later is needed"
#endif

namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// (x, y, theta), to which steps are added as they are.
struct Plane {
    static constexpr int kStorage = 3, kTangent = 3;
    static constexpr const char *kVertex = "VERTEX_SE2", *kEdge = "EDGE_SE2";
    using Residual = Eigen::Matrix<double, 3, 1>;
    using Jacobian = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

    static ceres::Manifold* manifold() { return nullptr; }

    static void between(const double* a, const double* b, const double* z, Residual& e, Jacobian& by_a,
                        Jacobian& by_b) {
        const Eigen::Matrix2d turn = Eigen::Rotation2Dd(-a[2] - z[2]).toRotationMatrix();
        const Eigen::Vector2d seen = turn * Eigen::Vector2d(b[0] - a[0], b[1] - a[1]);
        e.head<2>() = seen - Eigen::Rotation2Dd(-z[2]) * Eigen::Vector2d(z[0], z[1]);
        e[2] = std::remainder(b[2] - a[2] - z[2], 2.0 * M_PI);
        by_b.setIdentity();
        by_b.topLeftCorner<2, 2>() = turn;
        by_a = -by_b;
        by_a(0, 2) = seen.y();
        by_a(1, 2) = -seen.x();
    }
};

Matrix3d hat(const Vector3d& v) {
    Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

Vector3d log(Quaterniond q) {
    if (q.w() < 0) q.coeffs() = -q.coeffs();
    const double sine = q.vec().norm();
    return q.vec() * (sine < 1e-12 ? 2.0 : 2.0 * std::atan2(sine, q.w()) / sine);
}

Quaterniond exp(const Vector3d& w) {
    const double angle = w.norm();
    return angle < 1e-12 ? Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2).normalized()
                         : Quaterniond(Eigen::AngleAxisd(angle, w / angle));
}

Matrix3d inverse_right_jacobian(const Vector3d& w) {
    const double angle = w.norm();
    const double c = angle < 1e-4 ? 1.0 / 12.0 : 1.0 / (angle * angle) - 0.5 / (angle * std::tan(0.5 * angle));
    const Matrix3d skew = hat(w);
    return Matrix3d::Identity() + 0.5 * skew + c * skew * skew;
}

// (x, y, z, qx, qy, qz, qw); t <- t + v, q <- q exp(w). Cost functions give derivatives by (v, w) in the first six
// columns, and the manifold takes these as they are: Ceres has less to multiply than with derivatives by quaternions.
class PoseManifold final : public ceres::Manifold {
public:
    int AmbientSize() const override { return 7; }
    int TangentSize() const override { return 6; }
    bool Plus(const double* x, const double* step, double* out) const override {
        Eigen::Map<Vector3d>{out} = Eigen::Map<const Vector3d>(x) + Eigen::Map<const Vector3d>(step);
        Eigen::Map<Quaterniond>{out + 3} =
            (Eigen::Map<const Quaterniond>(x + 3) * exp(Eigen::Map<const Vector3d>(step + 3))).normalized();
        return true;
    }
    bool PlusJacobian(const double*, double* out) const override {
        Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(out).setIdentity();
        return true;
    }
    bool Minus(const double*, const double*, double*) const override { return false; }
    bool MinusJacobian(const double*, double*) const override { return false; }
};

struct Space {
    static constexpr int kStorage = 7, kTangent = 6;
    static constexpr const char *kVertex = "VERTEX_SE3:QUAT", *kEdge = "EDGE_SE3:QUAT";
    using Residual = Eigen::Matrix<double, 6, 1>;
    using Jacobian = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

    static ceres::Manifold* manifold() { return new PoseManifold; }

    static void between(const double* a, const double* b, const double* z, Residual& e, Jacobian& by_a,
                        Jacobian& by_b) {
        using Vector = Eigen::Map<const Vector3d>;
        const Eigen::Map<const Quaterniond> q_a(a + 3), q_b(b + 3), q_z(z + 3);
        const Matrix3d unturn = q_z.toRotationMatrix().transpose(), from_a = q_a.toRotationMatrix().transpose();
        const Vector3d seen = from_a * (Vector(b) - Vector(a));
        e.head<3>() = unturn * (seen - Vector(z));
        e.tail<3>() = log(q_z.conjugate() * q_a.conjugate() * q_b);
        const Matrix3d turn = unturn * from_a, inverse = inverse_right_jacobian(e.tail<3>());
        by_a.setZero();
        by_b.setZero();
        by_a.block<3, 3>(0, 0) = -turn;
        by_b.block<3, 3>(0, 0) = turn;
        by_a.block<3, 3>(0, 3) = unturn * hat(seen);
        by_a.block<3, 3>(3, 3) = -inverse * (q_b.conjugate() * q_a).toRotationMatrix();
        by_b.block<3, 3>(3, 3) = inverse;
    }
};

template <class Pose>
class Between final : public ceres::SizedCostFunction<Pose::kTangent, Pose::kStorage, Pose::kStorage> {
public:
    using Information = Eigen::Matrix<double, Pose::kTangent, Pose::kTangent>;

    Between(const double* z, const Information& information)
        : z_(z, z + Pose::kStorage), root_(information.llt().matrixU()) {}

    bool Evaluate(double const* const* poses, double* residuals, double** jacobians) const override {
        typename Pose::Residual e;
        typename Pose::Jacobian by_a, by_b;
        Pose::between(poses[0], poses[1], z_.data(), e, by_a, by_b);
        Eigen::Map<typename Pose::Residual>{residuals}.noalias() = root_ * e;
        if (jacobians == nullptr) return true;
        for (const auto& [to, jacobian] : {std::pair{jacobians[0], &by_a}, std::pair{jacobians[1], &by_b}}) {
            if (to != nullptr) Eigen::Map<typename Pose::Jacobian>(to).noalias() = root_ * *jacobian;
        }
        return true;
    }

private:
    std::vector<double> z_;
    Eigen::Matrix<double, Pose::kTangent, Pose::kTangent, Eigen::DontAlign> root_;
};

struct Result {
    double seconds = std::numeric_limits<double>::infinity(), chi2 = 0;
};

template <class Pose>
Result solve(const char* path, int iterations, ceres::SparseLinearAlgebraLibraryType library) {
    ceres::Problem problem;
    std::map<long, std::vector<double>> poses;
    ceres::Manifold* manifold = Pose::manifold();
    std::ifstream file(path);
    for (std::string line, tag; std::getline(file, line);) {
        std::istringstream words(line);
        words >> tag;
        if (tag == Pose::kVertex) {
            long key;
            words >> key;
            std::vector<double>& pose = poses[key];
            pose.resize(Pose::kStorage);
            for (double& number : pose) words >> number;
            problem.AddParameterBlock(pose.data(), Pose::kStorage, manifold);
            if (poses.size() == 1) problem.SetParameterBlockConstant(pose.data());
        } else if (tag == Pose::kEdge) {
            long from, to;
            double z[Pose::kStorage];
            typename Between<Pose>::Information information;
            words >> from >> to;
            for (double& number : z) words >> number;
            for (int i = 0; i < Pose::kTangent; ++i) {
                for (int j = i; j < Pose::kTangent; ++j) {
                    words >> information(i, j);
                    information(j, i) = information(i, j);
                }
            }
            problem.AddResidualBlock(new Between<Pose>(z, information), nullptr, poses.at(from).data(),
                                     poses.at(to).data());
        }
        if (!words) std::fprintf(stderr, "not understood: %s\n", line.c_str());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.sparse_linear_algebra_library_type = library;
    options.max_num_iterations = iterations;
    options.num_threads = 1;
    options.initial_trust_region_radius = 1e16;  // so that Levenberg-Marquardt takes Gauss-Newton steps
    options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    const std::clock_t start = std::clock();
    ceres::Solve(options, &problem, &summary);
    const double spent = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    const size_t steps = summary.iterations.size() - 1;  // the first entry is the start
    if (!summary.IsSolutionUsable() || steps == 0) return {};
    return {spent / static_cast<double>(steps), 2.0 * summary.final_cost};
}

}  // namespace

int main(int count, char** arguments) {
    if (count != 3) return std::fprintf(stderr, "usage: %s FILE.g2o ITERATIONS\n", arguments[0]), 2;
    const int iterations = std::atoi(arguments[2]);
    std::ifstream file(arguments[1]);
    std::string first;
    file >> first;
    Result best;
    const char* name = "none";
    for (const auto library : {ceres::SUITE_SPARSE, ceres::EIGEN_SPARSE}) {
        if (!ceres::IsSparseLinearAlgebraLibraryTypeAvailable(library)) continue;
        const Result result = first == Plane::kVertex ? solve<Plane>(arguments[1], iterations, library)
                                                      : solve<Space>(arguments[1], iterations, library);
        if (result.seconds >= best.seconds) continue;
        best = result;
        name = ceres::SparseLinearAlgebraLibraryTypeToString(library);
    }
    std::printf("%s %s %.17g %.17g\n", CERES_VERSION_STRING, name, best.seconds, best.chi2);
    return 0;
}
