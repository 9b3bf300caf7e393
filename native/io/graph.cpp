#include "graph.hpp"

#include <charconv>
#include <cmath>
#include <unordered_map>

#include "text.hpp"

namespace clew::io {

namespace {

std::int64_t count_tokens(Tokens tokens) {
    std::int64_t count = 0;
    while (!tokens.next().empty()) ++count;
    return count;
}

class Parser {
public:
    Parser(std::string_view text, const std::vector<GraphRecord>& records) : lines_(text), records_(records) {
        out_.tables.resize(records.size());
        for (std::size_t i = 0; i < records.size(); ++i) kinds_.emplace(records[i].tag, i);
    }

    GraphRecords run() {
        std::string_view line;
        std::size_t last = 0;
        while (out_.bad_line == 0 && lines_.next(line)) {
            Tokens tokens(line);
            const auto tag = tokens.next();
            if (tag.empty() || tag[0] == '#') continue;
            if (last < records_.size() && tag == records_[last].tag) {
                record(last, tokens);  // files keep one kind together
            } else if (const auto found = kinds_.find(tag); found != kinds_.end()) {
                last = found->second;
                record(last, tokens);
            } else if (tag == "FIX") {
                fix(tokens);
            } else if (tag == "DATA_FEATURE_POINTXY") {
                feature(tokens);
            } else {
                out_.unknown.emplace_back(lines_.number(), std::string(line));
            }
        }
        return std::move(out_);
    }

private:
    Lines lines_;
    const std::vector<GraphRecord>& records_;
    std::unordered_map<std::string_view, std::size_t> kinds_;
    GraphRecords out_;
    std::int64_t last_vertex_ = 0;
    bool any_vertex_ = false;

    void fail(std::string_view tag, std::string_view token, std::string_view wanted) {
        out_.bad_line = lines_.number();
        out_.bad = std::string(tag) + ": " + std::string(wanted) + " expected, found ";
        out_.bad += token.empty() ? "the end of the line" : "'" + std::string(token.substr(0, 40)) + "'";
    }

    bool integers(std::string_view tag, Tokens& tokens, int count, std::vector<std::int64_t>& to) {
        for (int i = 0; i < count; ++i) {
            const auto token = tokens.next();
            std::int64_t id = 0;
            if (!parse_int(token, id)) {
                fail(tag, token, "an integer id");
                return false;
            }
            to.push_back(id);
        }
        return true;
    }

    bool numbers(std::string_view tag, Tokens& tokens, int count, std::vector<double>& to) {
        for (int i = 0; i < count; ++i) {
            const auto token = tokens.next();
            double number = 0;
            if (!parse_double(token, number) || !std::isfinite(number)) {
                fail(tag, token, "a finite number");
                return false;
            }
            to.push_back(number);
        }
        return true;
    }

    void done(std::string_view tag, Tokens& tokens) {
        const auto token = tokens.next();
        if (!token.empty() && token[0] != '#') fail(tag, token, "the end of the line");
    }

    void record(std::size_t kind, Tokens& tokens) {
        const GraphRecord& record = records_[kind];
        GraphTable& table = out_.tables[kind];
        table.ids.push_back(lines_.number());
        const bool has_parameter = record.parameter && count_tokens(tokens) > record.ids + record.numbers;
        if (!integers(record.tag, tokens, record.ids + (has_parameter ? 1 : 0), table.ids)) return;
        if (record.parameter && !has_parameter) table.ids.push_back(-1);
        if (!numbers(record.tag, tokens, record.numbers, table.numbers)) return;
        if (record.ids == 1 && record.tag.rfind("VERTEX", 0) == 0) {
            last_vertex_ = table.ids.back();
            any_vertex_ = true;
        }
        done(record.tag, tokens);
    }

    void fix(Tokens& tokens) {
        for (auto token = tokens.next(); !token.empty() && token[0] != '#'; token = tokens.next()) {
            std::int64_t id = 0;
            if (!parse_int(token, id)) return fail("FIX", token, "an integer id");
            out_.fixed.push_back(lines_.number());
            out_.fixed.push_back(id);
        }
    }

    void feature(Tokens& tokens) {
        constexpr std::string_view tag = "DATA_FEATURE_POINTXY";
        if (!any_vertex_) return fail(tag, tag, "a vertex before it that it belongs to");
        std::vector<std::int64_t> header;  // kind of sensor and of feature
        if (!integers(tag, tokens, 2, header)) return;
        if (!numbers(tag, tokens, 5, out_.feature_numbers)) return;
        out_.features.push_back(lines_.number());
        out_.features.push_back(last_vertex_);
        done(tag, tokens);
    }
};

}  // namespace

GraphRecords parse_graph(std::string_view text, const std::vector<GraphRecord>& records) {
    return Parser(text, records).run();
}

std::string format_records(std::string_view tag, const std::int64_t* ids, const double* numbers, std::size_t rows,
                           std::size_t id_columns, std::size_t number_columns) {
    std::string out;
    out.reserve(rows * (tag.size() + id_columns * 7 + number_columns * 12));
    char buffer[64];
    for (std::size_t row = 0; row < rows; ++row) {
        out += tag;
        for (std::size_t i = 0; i < id_columns; ++i) {
            const auto end = std::to_chars(buffer, buffer + sizeof buffer, ids[row * id_columns + i]).ptr;
            out += ' ';
            out.append(buffer, end);
        }
        for (std::size_t i = 0; i < number_columns; ++i) {
            // Adding zero turns -0 into 0.
            const double number = numbers[row * number_columns + i] + 0.0;
            const auto end = std::to_chars(buffer, buffer + sizeof buffer, number).ptr;
            out += ' ';
            out.append(buffer, end);
        }
        out += '\n';
    }
    return out;
}

}  // namespace clew::io
