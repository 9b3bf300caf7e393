// Lines of numbers, a fixed count each.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

namespace clew::io {

struct Table {
    std::vector<double> values;       // rows x columns
    std::vector<std::int64_t> lines;  // line number of each row
    std::int64_t bad_line = 0;        // first line that is not `columns` finite numbers; 0 if none
    std::int64_t bad_count = 0;       // numbers that this line began with
};

// Comments (`#`) and empty lines are passed over. Commas count as blanks.
Table parse_table(std::string_view text, std::int64_t columns);

}  // namespace clew::io
