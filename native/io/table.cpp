#include "table.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "text.hpp"

namespace clew::io {

Table parse_table(std::string_view text, std::int64_t columns) {
    Table table;
    Lines lines(text);
    std::string_view line;
    std::string spaced;
    while (lines.next(line)) {
        if (line.find(',') != std::string_view::npos) {
            spaced.assign(line);
            std::replace(spaced.begin(), spaced.end(), ',', ' ');
            line = spaced;
        }
        Tokens tokens(line);
        const auto rest = tokens.rest();
        if (rest.empty() || rest[0] == '#') continue;
        std::int64_t count = 0;
        double value = 0;
        bool clean = true;
        for (auto token = tokens.next(); !token.empty(); token = tokens.next()) {
            clean = parse_double(token, value) && std::isfinite(value);
            if (!clean) break;
            if (count < columns) table.values.push_back(value);
            ++count;
        }
        if (count != columns || !clean) {
            table.values.resize(table.lines.size() * static_cast<std::size_t>(columns));
            table.bad_line = lines.number();
            table.bad_count = count;
            break;
        }
        table.lines.push_back(lines.number());
    }
    return table;
}

}  // namespace clew::io
