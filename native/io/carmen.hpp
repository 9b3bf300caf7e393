// Records of a CARMEN text log as arrays.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace clew::io {

struct CarmenRecords {
    static constexpr int kScanNumbers = 12;  // columns of `scan_numbers`, see below
    static constexpr int kOdometryNumbers = 6;

    // Rows of: ipc time, logger time, laser x y theta, robot x y theta (nan if not in the record),
    // start angle, field of view, angular resolution, maximum range (nan in FLASER).
    std::vector<double> scan_numbers;
    // Rows of: kind (0 FLASER, 1 ROBOTLASER1), number of readings, index of the first reading, line.
    std::vector<std::int64_t> scan_integers;
    std::vector<double> ranges;
    // Rows of: ipc time, logger time, x, y, theta, line.
    std::vector<double> odometry;
    std::vector<std::pair<std::string, std::string>> parameters;
    std::map<std::string, std::int64_t> skipped;  // reason -> number of lines
    std::int64_t damaged = 0;                     // lines that are no record at all, or a broken one
};

CarmenRecords parse_carmen(std::string_view text);

}  // namespace clew::io
