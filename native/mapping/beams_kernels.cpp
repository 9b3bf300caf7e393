// Which beam of a sensor points at each point, and how far away it is.
#include "mapping/visibility.hpp"

namespace clew::CLEW_ISA {

namespace {

constexpr double kHalfTurn = 3.14159265358979323846, kTurn = 2 * kHalfTurn;

double larger(double a, double b) { return a > b ? a : b; }
double smaller(double a, double b) { return a < b ? a : b; }

// atan2 to 2e-5 rad, a thousandth of the angle between two beams, in a form that compilers turn into vector
// instructions (Abramowitz & Stegun, Handbook of Mathematical Functions, 4.4.49).
double direction(double x, double y) {
    const double ax = larger(x, -x), ay = larger(y, -y);
    const double t = smaller(ax, ay) / larger(larger(ax, ay), 1e-12), s = t * t;
    double angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))));
    angle = ay > ax ? 0.5 * kHalfTurn - angle : angle;
    angle = x < 0 ? kHalfTurn - angle : angle;
    return y < 0 ? -angle : angle;
}

}  // namespace

void beams_at(const mapping::Beams& b, const double* points, std::size_t count, double* beam, double* distance) {
    const double x0 = b.x, y0 = b.y, c = b.cosine, s = b.sine, middle = b.middle, scale = b.per_beam, half = b.half;
    for (std::size_t i = 0; i < count; ++i) {
        const double x = x0 + c * points[2 * i] - s * points[2 * i + 1];
        const double y = y0 + s * points[2 * i] + c * points[2 * i + 1];
        double off = direction(x, y) - middle;
        off = off > kHalfTurn ? off - kTurn : off;  // within half a turn of the middle beam
        off = off < -kHalfTurn ? off + kTurn : off;
        beam[i] = off * scale + half;
        distance[i] = __builtin_sqrt(x * x + y * y);
    }
}

}  // namespace clew::CLEW_ISA
