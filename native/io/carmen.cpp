// CARMEN log files, one record a line (http://carmen.sourceforge.net, logger: log file format).
#include "carmen.hpp"

#include <array>
#include <cmath>
#include <limits>

#include "text.hpp"

namespace clew::io {

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr std::int64_t kMostReadings = 100000;

// The fields behind the readings: numbers, one host name among them, perhaps numbers again.
struct Tail {
    std::array<double, 32> numbers{};
    int count = 0;
    int host = -1;  // how many numbers came before the host name; -1 without one
    bool good = true;
};

Tail read_tail(Tokens& tokens) {
    Tail tail;
    for (auto token = tokens.next(); !token.empty(); token = tokens.next()) {
        if (tail.count == static_cast<int>(tail.numbers.size())) break;
        double value = kNan;
        if (parse_double(token, value)) {
            tail.numbers[static_cast<std::size_t>(tail.count++)] = value;
        } else if (tail.host < 0) {
            tail.host = tail.count;
        } else {
            tail.good = false;
        }
    }
    return tail;
}

bool finite(const double* values, int count) {
    for (int i = 0; i < count; ++i) {
        if (!std::isfinite(values[i])) return false;
    }
    return true;
}

class Parser {
public:
    CarmenRecords run(std::string_view text) {
        Lines lines(text);
        std::string_view line;
        while (lines.next(line)) {
            Tokens tokens(line);
            const auto tag = tokens.next();
            if (tag.empty() || tag[0] == '#') continue;
            if (tag == "FLASER") {
                scan(tokens, lines.number(), false);
            } else if (tag == "ROBOTLASER1") {
                scan(tokens, lines.number(), true);
            } else if (tag == "ODOM") {
                odometry(tokens, lines.number());
            } else if (tag == "PARAM") {
                parameter(tokens);
            } else {
                other(tag);
            }
        }
        return std::move(out_);
    }

private:
    CarmenRecords out_;

    void damaged(const char* reason) {
        ++out_.skipped[reason];
        ++out_.damaged;
    }

    void other(std::string_view tag) {
        // A file of noise must not fill the report with its "tags".
        if (is_word(tag) && (out_.skipped.size() < 40 || out_.skipped.count(std::string(tag)))) {
            ++out_.skipped[std::string(tag)];
        } else {
            damaged("unreadable line");
        }
    }

    void parameter(Tokens& tokens) {
        const auto name = tokens.next();
        const auto value = tokens.next();
        if (value.empty()) return damaged("broken PARAM");
        out_.parameters.emplace_back(std::string(name), std::string(value));
    }

    void odometry(Tokens& tokens, std::int64_t line) {
        // x y theta tv rv accel ipc_time host logger_time
        const Tail tail = read_tail(tokens);
        const auto& n = tail.numbers;
        if (!tail.good || tail.count < 7 || (tail.host >= 0 && tail.host != 7) || !finite(n.data(), 3) ||
            !std::isfinite(n[6])) {
            return damaged("broken ODOM");
        }
        const double logger = tail.host == 7 && tail.count > 7 ? n[7] : kNan;
        const double row[] = {n[6], logger, n[0], n[1], n[2], static_cast<double>(line)};
        out_.odometry.insert(out_.odometry.end(), std::begin(row), std::end(row));
    }

    // Reads `count` numbers; whether all were there.
    bool readings(Tokens& tokens, std::int64_t count) {
        for (std::int64_t i = 0; i < count; ++i) {
            double range = kNan;
            if (!tokens.next_double(range)) return false;
            out_.ranges.push_back(range);
        }
        return true;
    }

    void scan(Tokens& tokens, std::int64_t line, bool robotlaser) {
        const std::size_t first = out_.ranges.size();
        if (!scan_record(tokens, line, robotlaser, first)) {
            out_.ranges.resize(first);
            damaged(robotlaser ? "broken ROBOTLASER1" : "broken FLASER");
        }
    }

    bool scan_record(Tokens& tokens, std::int64_t line, bool robotlaser, std::size_t first) {
        // laser_type start_angle field_of_view angular_resolution maximum_range accuracy remission_mode
        double header[7] = {kNan, kNan, kNan, kNan, kNan, kNan, kNan};
        if (robotlaser) {
            for (double& value : header) {
                if (!tokens.next_double(value)) return false;
            }
        }
        std::int64_t count = 0;
        if (!tokens.next_int(count) || count < 1 || count > kMostReadings || !readings(tokens, count)) {
            return false;
        }
        double numbers[CarmenRecords::kScanNumbers];
        const bool posed = robotlaser ? robotlaser_tail(tokens, numbers) : flaser_tail(tokens, numbers);
        if (!posed || !std::isfinite(numbers[0]) || !finite(numbers + 2, 3)) return false;
        for (int i = 0; i < 4; ++i) numbers[8 + i] = header[1 + i];
        const std::int64_t integers[] = {robotlaser ? 1 : 0, count, static_cast<std::int64_t>(first), line};
        out_.scan_numbers.insert(out_.scan_numbers.end(), std::begin(numbers), std::end(numbers));
        out_.scan_integers.insert(out_.scan_integers.end(), std::begin(integers), std::end(integers));
        return true;
    }

    // x y theta odom_x odom_y odom_theta ipc_time host logger_time; old logs lack the second pose.
    static bool flaser_tail(Tokens& tokens, double* out) {
        const Tail tail = read_tail(tokens);
        const auto& n = tail.numbers;
        if (!tail.good) return false;
        const bool one_pose = tail.host == 4;
        const int time = one_pose ? 3 : 6;
        if (tail.count <= time || (tail.host >= 0 && tail.host != time + 1)) return false;
        out[0] = n[static_cast<std::size_t>(time)];
        out[1] = tail.host >= 0 && tail.count > time + 1 ? n[static_cast<std::size_t>(time) + 1] : kNan;
        for (std::size_t i = 0; i < 3; ++i) {
            out[2 + i] = n[i];
            out[5 + i] = one_pose ? kNan : n[3 + i];
        }
        return one_pose || finite(out + 5, 3);
    }

    // num_remissions [remissions] laser pose, robot pose, tv, rv, forward and side safety distance, turn axis,
    // ipc_time host logger_time; the first logs of this kind lack the remissions and the turn axis.
    static bool robotlaser_tail(Tokens& tokens, double* out) {
        Tokens ahead = tokens;
        int left = 0, host = -1;
        for (auto token = ahead.next(); !token.empty(); token = ahead.next()) {
            double value = kNan;
            if (!parse_double(token, value)) host = left;
            ++left;
        }
        const int before_time = (host >= 0 ? host : left - 2) - 1;  // fields in front of ipc_time
        if (before_time < 10) return false;
        if (before_time > 11) {
            std::int64_t remissions = 0;
            if (!tokens.next_int(remissions) || remissions < 0 || remissions + 11 > before_time) return false;
            for (std::int64_t i = 0; i < remissions; ++i) tokens.next();
        }
        const Tail tail = read_tail(tokens);
        const auto& n = tail.numbers;
        const int time = tail.host >= 0 ? tail.host - 1 : tail.count - 2;
        if (!tail.good || time < 10) return false;
        out[0] = n[static_cast<std::size_t>(time)];
        out[1] = tail.count > time + 1 ? n[static_cast<std::size_t>(time) + 1] : kNan;
        for (std::size_t i = 0; i < 6; ++i) out[2 + i] = n[i];
        return finite(out + 5, 3);
    }
};

}  // namespace

CarmenRecords parse_carmen(std::string_view text) { return Parser().run(text); }

}  // namespace clew::io
