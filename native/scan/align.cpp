#include "align.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace clew::scan {

namespace {

constexpr std::size_t coarse_points = 90;
constexpr double small_step = 1e-4, small_turn = 1e-5;  // metres, radians: far below the noise of a match

struct Normal {
    double h[6] = {0, 0, 0, 0, 0, 0};  // xx, xy, xt, yy, yt, tt
    double g[3] = {0, 0, 0};
    double weight = 0, squares = 0;
    std::size_t partners = 0;

    void add(double jx, double jy, double jt, double r, double w) {
        h[0] += w * jx * jx; h[1] += w * jx * jy; h[2] += w * jx * jt;
        h[3] += w * jy * jy; h[4] += w * jy * jt; h[5] += w * jt * jt;
        g[0] += w * jx * r; g[1] += w * jy * r; g[2] += w * jt * r;
    }
};

// What a return adds to the gradient: its weighted residual times its Jacobian.
struct Score {
    double value = 0, weight = 0, j[3] = {0, 0, 0};
};

const Entry* nearest(const PointIndexView& t, double x, double y, double nx, double ny, double facing, double radius) {
    const auto clamp_cell = [&](double v, std::int32_t limit) {  // truncation is floor where nothing is negative
        return static_cast<std::int32_t>(std::clamp(v / t.cell, 0.0, limit - 1.0));
    };
    const double lx = x - t.origin_x, ly = y - t.origin_y;
    if (lx < -radius || ly < -radius || lx > t.width * t.cell + radius || ly > t.height * t.cell + radius) return nullptr;
    const std::int32_t x0 = clamp_cell(lx - radius, t.width), x1 = clamp_cell(lx + radius, t.width);
    const std::int32_t y0 = clamp_cell(ly - radius, t.height), y1 = clamp_cell(ly + radius, t.height);
    double best = radius * radius;
    const Entry* found = nullptr;
    for (std::int32_t by = y0; by <= y1; ++by) {
        const std::int32_t* row = t.starts + static_cast<std::ptrdiff_t>(by) * t.width;
        // Buckets of one row lie next to each other.
        for (const Entry *entry = t.entries + row[x0], *end = t.entries + row[x1 + 1]; entry < end; ++entry) {
            const double dx = entry->x - x, dy = entry->y - y;
            const double d = dx * dx + dy * dy;
            if (d < best && entry->nx * nx + entry->ny * ny >= facing) {
                best = d;
                found = entry;
            }
        }
    }
    return found;
}

Normal linearise(const PointIndexView& target, const double* points, const double* normals, const double* weights,
                 std::size_t n, std::size_t stride, const Pose& pose, double radius, const AlignOptions& o,
                 Score* scores = nullptr) {
    Normal out;
    const double c = std::cos(pose.theta), s = std::sin(pose.theta);
    const double precision = 1.0 / (o.sigma * o.sigma), scale2 = o.robust * o.robust * o.sigma * o.sigma;
    for (std::size_t i = 0; i < n; i += stride) {
        const double px = points[2 * i], py = points[2 * i + 1];
        const double x = c * px - s * py + pose.x, y = s * px + c * py + pose.y;
        const double mx = c * normals[2 * i] - s * normals[2 * i + 1], my = s * normals[2 * i] + c * normals[2 * i + 1];
        const Entry* partner = nearest(target, x, y, mx, my, o.facing, radius);
        if (!partner) continue;
        const double nx = partner->nx, ny = partner->ny;
        const double dx = x - partner->x, dy = y - partner->y;
        const double r = nx * dx + ny * dy;
        const double w = weights[i] / (1.0 + r * r / scale2);
        // d(residual) of the right-hand tangent: n^T R v + n^T R (-py, px) w.
        const double jx = nx * c + ny * s, jy = -nx * s + ny * c;
        out.add(jx, jy, -jx * py + jy * px, r, w * precision);
        const double tangential = partner->along;
        if (tangential > 0) {
            const double q = -ny * dx + nx * dy;
            const double kx = -ny * c + nx * s, ky = ny * s + nx * c;
            out.add(kx, ky, -kx * py + ky * px, q, tangential * weights[i] / (1.0 + q * q / scale2) * precision);
        }
        out.weight += w;
        out.squares += w * r * r;
        if (scores) scores[i] = {w * r, w, {jx, jy, -jx * py + jy * px}};
        ++out.partners;
    }
    return out;
}

// Solves the symmetric 3x3 system h x = b by an LDL^T with a floor on the pivots; zero along what nothing measures.
void solve3(const double* h, const double* b, double* x) {
    const double floor_ = 1e-9 * (std::abs(h[0]) + std::abs(h[3]) + std::abs(h[5])) + 1e-300;
    const double d0 = std::max(h[0], floor_);
    const double l10 = h[1] / d0, l20 = h[2] / d0;
    const double d1 = std::max(h[3] - l10 * h[1], floor_);
    const double m21 = h[4] - l20 * h[1], l21 = m21 / d1;
    const double d2 = std::max(h[5] - l20 * h[2] - l21 * m21, floor_);
    const double y0 = b[0], y1 = b[1] - l10 * y0, y2 = b[2] - l20 * y0 - l21 * y1;
    x[2] = y2 / d2;
    x[1] = y1 / d1 - l21 * x[2];
    x[0] = y0 / d0 - l10 * x[1] - l20 * x[2];
}

void add_prior(Normal& normal, const Pose& pose, const Pose& prior, const double* information) {
    // Residual R_prior^T (t - t_prior), theta - theta_prior; its derivative for v is the relative rotation.
    const double c0 = std::cos(prior.theta), s0 = std::sin(prior.theta);
    const double dx = pose.x - prior.x, dy = pose.y - prior.y, dt = wrap(pose.theta - prior.theta);
    const double e[3] = {c0 * dx + s0 * dy, -s0 * dx + c0 * dy, dt};
    const double c = std::cos(dt), s = std::sin(dt);
    const double jac[3][3] = {{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
    double oj[3][3], oe[3];
    for (int a = 0; a < 3; ++a) {
        oe[a] = information[3 * a] * e[0] + information[3 * a + 1] * e[1] + information[3 * a + 2] * e[2];
        for (int b = 0; b < 3; ++b)
            oj[a][b] = information[3 * a] * jac[0][b] + information[3 * a + 1] * jac[1][b] + information[3 * a + 2] * jac[2][b];
    }
    const int upper[6][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}};
    for (int k = 0; k < 6; ++k)
        for (int a = 0; a < 3; ++a) normal.h[k] += jac[a][upper[k][0]] * oj[a][upper[k][1]];
    for (int b = 0; b < 3; ++b)
        for (int a = 0; a < 3; ++a) normal.g[b] += jac[a][b] * oe[a];
}

// Covariance of the gradient from the residuals: products of the parts of returns that lie near each other along the
// scan (Newey and West, Econometrica 1987; their lags are metres here).
void find_push(const std::vector<Score>& scores, const double* points, const AlignOptions& o, AlignResult& out) {
    const double length = o.correlated, unit = 1.0 / (o.sigma * o.sigma * o.sigma * o.sigma);
    double weights = 0, own = 0, together = 0;
    for (std::size_t i = 0; i < scores.size(); ++i) {
        const Score& here = scores[i];
        if (here.weight == 0) continue;
        double beside[3] = {0, 0, 0}, next = 0;
        for (std::size_t j = i + 1; j < scores.size(); ++j) {
            const double dx = points[2 * j] - points[2 * i], dy = points[2 * j + 1] - points[2 * i + 1];
            const double squared = dx * dx + dy * dy;
            if (squared >= length * length) break;
            const double part = (1.0 - std::sqrt(squared) / length) * scores[j].value;
            for (int a = 0; a < 3; ++a) beside[a] += part * scores[j].j[a];
            next += part;
        }
        weights += here.weight * here.weight;
        own += here.value * here.value;
        together += here.value * (here.value + 2.0 * next);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                const double square = here.j[a] * here.j[b];
                out.push[3 * a + b] += unit * here.value * (here.value * square + here.j[a] * beside[b] + beside[a] * here.j[b]);
                out.spread[3 * a + b] += unit * here.weight * here.weight * square;
            }
    }
    out.correlation = own > 0 ? std::max(together, 0.0) / own : 1.0;
    out.variance = weights > 0 ? std::max(together, 0.0) / weights : 0.0;
}

}  // namespace

AlignResult align(const PointIndexView& target, const double* points, const double* normals, const double* weights,
                  std::size_t n, const Pose& start, const Pose& prior, const double* prior_information,
                  const AlignOptions& o) {
    Pose pose = start;
    double radius = o.radius_start;
    std::int32_t iteration = 0;
    for (; iteration < o.iterations; ++iteration) {
        // While partners are still sought far away, a part of the points leads just as well to where they are near.
        const bool last_radius = radius <= o.radius_end;
        const std::size_t stride = last_radius ? 1 : std::max<std::size_t>(1, n / coarse_points);
        Normal normal = linearise(target, points, normals, weights, n, stride, pose, radius, o);
        add_prior(normal, pose, prior, prior_information);
        double step[3];
        const double b[3] = {-normal.g[0], -normal.g[1], -normal.g[2]};
        solve3(normal.h, b, step);
        const double length = std::hypot(step[0], step[1]);
        if (length > o.radius_start) { step[0] *= o.radius_start / length; step[1] *= o.radius_start / length; }
        step[2] = std::clamp(step[2], -0.2, 0.2);
        const double c = std::cos(pose.theta), s = std::sin(pose.theta);
        pose.x += c * step[0] - s * step[1];
        pose.y += s * step[0] + c * step[1];
        pose.theta = wrap(pose.theta + step[2]);
        const bool small = length < small_step && std::abs(step[2]) < small_turn;
        if (last_radius && small) break;
        radius = small ? o.radius_end : std::max(o.radius_end, 0.6 * radius);
    }
    std::vector<Score> scores(o.correlated > 0 ? n : 0);
    const Normal data = linearise(target, points, normals, weights, n, 1, pose, o.radius_end, o,
                                  scores.empty() ? nullptr : scores.data());
    AlignResult out{};
    out.pose = pose;
    const double* h = data.h;
    const double full[9] = {h[0], h[1], h[2], h[1], h[3], h[4], h[2], h[4], h[5]};
    std::copy(full, full + 9, out.information);
    const double b[3] = {-data.g[0], -data.g[1], -data.g[2]};
    solve3(data.h, b, out.step);
    out.overlap = n ? static_cast<double>(data.partners) / static_cast<double>(n) : 0.0;
    out.rms = data.weight > 0 ? std::sqrt(data.squares / data.weight) : 0.0;
    find_push(scores, points, o, out);
    out.iterations = iteration;
    return out;
}

}  // namespace clew::scan
