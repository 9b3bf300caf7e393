// Records of a pose-graph file (g2o, TORO) as arrays, one table a tag.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace clew::io {

// What the fields behind a tag are: `ids` integers, then `numbers` numbers. With `parameter`, one more integer
// (the id of a PARAMS line) may stand behind the ids; it is -1 where the line has none.
struct GraphRecord {
    std::string tag;
    int ids = 0;
    int numbers = 0;
    bool parameter = false;
};

struct GraphTable {
    std::vector<std::int64_t> ids;  // rows of: line, ids, parameter (if any)
    std::vector<double> numbers;
};

struct GraphRecords {
    std::vector<GraphTable> tables;  // as the records asked for
    std::vector<std::int64_t> fixed;  // rows of: line, id (tag FIX)
    std::vector<std::int64_t> features;  // rows of: line, id of the vertex before it (tag DATA_FEATURE_POINTXY)
    std::vector<double> feature_numbers;  // x y and three of the information
    std::vector<std::pair<std::int64_t, std::string>> unknown;  // line, text
    std::int64_t bad_line = 0;
    std::string bad;  // what is wrong with it
};

GraphRecords parse_graph(std::string_view text, const std::vector<GraphRecord>& records);

// Lines `tag ids numbers`; numbers as short as they read back exactly.
std::string format_records(std::string_view tag, const std::int64_t* ids, const double* numbers, std::size_t rows,
                           std::size_t id_columns, std::size_t number_columns);

}  // namespace clew::io
