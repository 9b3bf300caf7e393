#include "correlate.hpp"

#include <algorithm>
#include <cmath>

namespace clew::scan {

namespace {

// Branch and bound over (angle, square of offsets): Hess et al. 2016, algorithm 3; the window is Olson's (2009).
class Search {
public:
    Search(const PyramidView& pyramid, const double* points, std::size_t n, const SearchOptions& options)
        : pyramid_(pyramid), n_(n), o_(options) {
        const double r = pyramid.resolution;
        steps_theta_ = static_cast<std::int32_t>(std::ceil(options.half_theta / options.step_theta - 1e-9));
        half_x_ = static_cast<std::int32_t>(std::ceil(options.half_x / r - 1e-9));
        half_y_ = static_cast<std::int32_t>(std::ceil(options.half_y / r - 1e-9));
        cells_.resize(static_cast<std::size_t>(2 * steps_theta_ + 1) * n * 2);
        for (std::int32_t k = -steps_theta_; k <= steps_theta_; ++k) {
            const double theta = options.centre.theta + k * options.step_theta;
            const double c = std::cos(theta), s = std::sin(theta);
            std::int32_t* xs = angle_cells(k);
            std::int32_t* ys = xs + n;
            for (std::size_t i = 0; i < n; ++i) {
                const double x = c * points[2 * i] - s * points[2 * i + 1] + options.centre.x;
                const double y = s * points[2 * i] + c * points[2 * i + 1] + options.centre.y;
                xs[i] = cell_of((x - pyramid.origin_x) / r);
                ys[i] = cell_of((y - pyramid.origin_y) / r);
            }
        }
    }

    SearchResult run() {
        std::int32_t top = pyramid_.levels - 1;
        while (top > 0 && (1 << (top - 1)) > 2 * std::max(half_x_, half_y_)) --top;
        std::vector<Node> roots;
        for (std::int32_t k = -steps_theta_; k <= steps_theta_; ++k)
            for (std::int32_t y = -half_y_; y <= half_y_; y += 1 << top)
                for (std::int32_t x = -half_x_; x <= half_x_; x += 1 << top) roots.push_back(evaluate(k, x, y, top));
        best_.score = o_.minimum_score;
        descend(roots, top);
        best_.evaluated = evaluated_;
        return best_;
    }

private:
    struct Node {
        std::int32_t k, x, y;
        double bound, likelihood;
    };

    std::int32_t* angle_cells(std::int32_t k) {
        return cells_.data() + static_cast<std::size_t>(k + steps_theta_) * n_ * 2;
    }

    // A point far outside stays outside at any offset of the window, and its cell a number that can be held.
    static std::int32_t cell_of(double v) { return floor_to<std::int32_t>(std::clamp(v, -1e9, 1e9)); }

    static double interval_distance(std::int32_t low, std::int32_t size) {
        if (low > 0) return low;
        return low + size - 1 < 0 ? -(low + size - 1) : 0;
    }

    double penalty(std::int32_t k, std::int32_t x, std::int32_t y, std::int32_t size) const {
        const double dx = interval_distance(x, size) * pyramid_.resolution / o_.prior_x;
        const double dy = interval_distance(y, size) * pyramid_.resolution / o_.prior_y;
        const double dt = k * o_.step_theta / o_.prior_theta;
        return o_.prior_weight * std::log1p(0.5 * (dx * dx + dy * dy + dt * dt));
    }

    Node evaluate(std::int32_t k, std::int32_t x, std::int32_t y, std::int32_t level) {
        const std::int32_t* xs = angle_cells(k);
        const std::int32_t* ys = xs + n_;
        const auto width = static_cast<std::uint32_t>(pyramid_.width), height = static_cast<std::uint32_t>(pyramid_.height);
        const std::uint8_t* cells = pyramid_.cells + static_cast<std::size_t>(level) * width * height;
        std::uint32_t sum = 0;
        for (std::size_t i = 0; i < n_; ++i) {
            const auto cx = static_cast<std::uint32_t>(xs[i] + x), cy = static_cast<std::uint32_t>(ys[i] + y);
            if (cx < width && cy < height) sum += cells[static_cast<std::size_t>(cy) * width + cx];
        }
        ++evaluated_;
        const double likelihood = n_ ? sum / (255.0 * static_cast<double>(n_)) : 0.0;
        return {k, x, y, likelihood - penalty(k, x, y, 1 << level), likelihood};
    }

    bool excluded(const Pose& pose) const {
        return o_.exclude && std::hypot(pose.x - o_.excluded.x, pose.y - o_.excluded.y) < o_.exclude_distance &&
               std::abs(wrap(pose.theta - o_.excluded.theta)) < o_.exclude_angle;
    }

    void descend(std::vector<Node>& nodes, std::int32_t level) {
        std::stable_sort(nodes.begin(), nodes.end(), [](const Node& a, const Node& b) { return a.bound > b.bound; });
        for (const Node& node : nodes) {
            if (node.bound <= best_.score) return;
            if (level == 0) {
                const Pose pose{o_.centre.x + node.x * pyramid_.resolution, o_.centre.y + node.y * pyramid_.resolution,
                                wrap(o_.centre.theta + node.k * o_.step_theta)};
                if (!excluded(pose)) best_ = {true, pose, node.bound, node.likelihood, 0};
                continue;
            }
            const std::int32_t half = 1 << (level - 1);
            std::vector<Node> children;
            children.reserve(4);
            for (const std::int32_t dy : {0, half})
                for (const std::int32_t dx : {0, half})
                    if (node.x + dx <= half_x_ && node.y + dy <= half_y_)
                        children.push_back(evaluate(node.k, node.x + dx, node.y + dy, level - 1));
            descend(children, level - 1);
        }
    }

    const PyramidView& pyramid_;
    std::size_t n_;
    const SearchOptions& o_;
    std::int32_t steps_theta_ = 0, half_x_ = 0, half_y_ = 0;
    std::vector<std::int32_t> cells_;
    SearchResult best_{false, {0, 0, 0}, 0.0, 0.0, 0};
    std::int64_t evaluated_ = 0;
};

}  // namespace

SearchResult correlate(const PyramidView& pyramid, const double* points, std::size_t n, const SearchOptions& options) {
    return Search(pyramid, points, n, options).run();
}

}  // namespace clew::scan
