#include <nanobind/stl/map.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "carmen.hpp"
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

}  // namespace

void bind_io(nb::module_ m) {
    m.def("parse_carmen", &parse_carmen, nb::arg("text"), "Records of a CARMEN text log as arrays.");
    m.def("parse_table", &parse_table, nb::arg("text"), nb::arg("columns"),
          "Rows of numbers, their lines, the first bad line (0: none) and how many numbers it began with.");
}

}  // namespace clew
