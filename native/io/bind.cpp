#include <nanobind/stl/map.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "carmen.hpp"
#include "graph.hpp"
#include "module.hpp"
#include "table.hpp"

namespace clew {

namespace {

// Hands a vector over to NumPy without a copy; `columns` 0 makes a one-dimensional array.
template <class T>
nb::object to_array(std::vector<T>&& values, std::size_t columns = 0) {
    auto* owned = new std::vector<T>(std::move(values));
    nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    const std::size_t rows = columns ? owned->size() / columns : owned->size();
    const std::size_t shape[] = {rows, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(owned->data(), columns ? 2 : 1, shape, owner));
}

std::string_view view(const nb::bytes& text) { return {text.c_str(), text.size()}; }

nb::dict parse_carmen(const nb::bytes& text) {
    io::CarmenRecords records;
    {
        const auto content = view(text);
        nb::gil_scoped_release release;
        records = io::parse_carmen(content);
    }
    nb::list parameters;
    for (const auto& [name, value] : records.parameters) {
        parameters.append(nb::make_tuple(nb::bytes(name.data(), name.size()), nb::bytes(value.data(), value.size())));
    }
    nb::dict out;
    out["scan_numbers"] = to_array(std::move(records.scan_numbers), io::CarmenRecords::kScanNumbers);
    out["scan_integers"] = to_array(std::move(records.scan_integers), 4);
    out["ranges"] = to_array(std::move(records.ranges));
    out["odometry"] = to_array(std::move(records.odometry), io::CarmenRecords::kOdometryNumbers);
    out["parameters"] = parameters;
    out["skipped"] = nb::cast(records.skipped);
    out["damaged"] = records.damaged;
    return out;
}

nb::tuple parse_table(const nb::bytes& text, std::int64_t columns) {
    if (columns < 1) throw nb::value_error("columns must be positive");
    io::Table table;
    {
        const auto content = view(text);
        nb::gil_scoped_release release;
        table = io::parse_table(content, columns);
    }
    return nb::make_tuple(to_array(std::move(table.values), static_cast<std::size_t>(columns)),
                          to_array(std::move(table.lines)), table.bad_line, table.bad_count);
}

nb::dict parse_graph(const nb::bytes& text, const std::vector<std::tuple<std::string, int, int, bool>>& kinds) {
    std::vector<io::GraphRecord> wanted;
    for (const auto& [tag, ids, numbers, parameter] : kinds) {
        if (tag.empty() || ids < 1 || numbers < 1) throw nb::value_error("a record has a tag, ids and numbers");
        wanted.push_back({tag, ids, numbers, parameter});
    }
    io::GraphRecords records;
    {
        const auto content = view(text);
        nb::gil_scoped_release release;
        records = io::parse_graph(content, wanted);
    }
    nb::dict out;
    out["bad_line"] = records.bad_line;
    out["bad"] = nb::bytes(records.bad.data(), records.bad.size());
    nb::dict tables;
    if (records.bad_line == 0) {  // a bad line leaves the tables uneven
        for (std::size_t i = 0; i < wanted.size(); ++i) {
            auto& table = records.tables[i];
            if (table.ids.empty()) continue;
            const std::size_t columns = 1 + static_cast<std::size_t>(wanted[i].ids) + (wanted[i].parameter ? 1 : 0);
            tables[wanted[i].tag.c_str()] =
                nb::make_tuple(to_array(std::move(table.ids), columns),
                               to_array(std::move(table.numbers), static_cast<std::size_t>(wanted[i].numbers)));
        }
    }
    out["tables"] = tables;
    out["fixed"] = to_array(std::move(records.fixed), 2);
    if (records.bad_line != 0) records.feature_numbers.clear();
    out["features"] = nb::make_tuple(to_array(std::move(records.features), 2),
                                     to_array(std::move(records.feature_numbers), 5));
    nb::list unknown;
    for (const auto& [line, content] : records.unknown) {
        unknown.append(nb::make_tuple(line, nb::bytes(content.data(), content.size())));
    }
    out["unknown"] = unknown;
    return out;
}

using Ids = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

nb::bytes format_records(const std::string& tag, const Ids& ids, const Numbers& numbers) {
    if (ids.shape(0) != numbers.shape(0)) throw nb::value_error("ids and numbers need as many rows");
    std::string text;
    {
        nb::gil_scoped_release release;
        text = io::format_records(tag, ids.data(), numbers.data(), ids.shape(0), ids.shape(1), numbers.shape(1));
    }
    return nb::bytes(text.data(), text.size());
}

}  // namespace

void bind_io(nb::module_ m) {
    m.def("parse_carmen", &parse_carmen, nb::arg("text"), "Records of a CARMEN text log as arrays.");
    m.def("parse_table", &parse_table, nb::arg("text"), nb::arg("columns"),
          "Rows of numbers, their lines, the first bad line (0: none) and how many numbers it began with.");
    m.def("parse_graph", &parse_graph, nb::arg("text"), nb::arg("records"),
          "Records (tag, ids, numbers, parameter) of a pose-graph file as arrays.");
    m.def("format_records", &format_records, nb::arg("tag"), nb::arg("ids"), nb::arg("numbers"),
          "Lines of a tag, ids and numbers that read back exactly.");
}

}  // namespace clew
