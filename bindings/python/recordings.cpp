// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>

#include <memory>
#include <string>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "tools/hdf5_file.h"
#include "tools/recording.h"

namespace forcegrid::python {
namespace {

using tools::Hdf5Column;
using tools::Hdf5Error;
using tools::Hdf5Reader;
using tools::Hdf5Type;
using tools::RecordingHeader;

// A recording that is open for reading. The GIL stays held: HDF5 is not made for threads.
class Recording {
 public:
  explicit Recording(const std::string& file)
      : reader_(std::make_unique<Hdf5Reader>(file)), header_(tools::read_header(*reader_)) {}

  [[nodiscard]] const Hdf5Reader& reader() const {
    if (!reader_) {
      throw Hdf5Error("the recording is closed");
    }
    return *reader_;
  }
  [[nodiscard]] const RecordingHeader& header() const { return header_; }
  void close() { reader_.reset(); }

  // "/cycles/time_s" for "cycles/time_s" or "time_s" of a cycle. @throws KeyError.
  [[nodiscard]] std::string full_name(const std::string& asked) const {
    for (const std::string& name : {"/" + asked, asked, "/cycles/" + asked}) {
      if (name.starts_with("/") && !name.starts_with("//") && reader().has(name)) {
        return name;
      }
    }
    throw py::key_error("no column '" + asked + "' in " + reader().file() +
                        "; Recording.columns has their names");
  }

  // After a kill, columns may differ by a block: what all of a group have is given.
  [[nodiscard]] std::uint64_t rows(const std::string& name) const {
    const std::uint64_t own = reader().rows(name);
    const std::uint64_t common = name.starts_with("/cycles/")    ? header_.cycles
                                 : name.starts_with("/samples/") ? header_.samples
                                                                 : own;
    return std::min(own, common);
  }

 private:
  std::unique_ptr<Hdf5Reader> reader_;
  RecordingHeader header_;
};

template <typename Number>
py::array converted(const std::vector<double>& numbers, const std::vector<py::ssize_t>& shape) {
  py::array_t<Number> array(shape);
  std::transform(numbers.begin(), numbers.end(), array.mutable_data(),
                 [](double number) { return static_cast<Number>(number); });
  return array;
}

py::array column(const Recording& self, const std::string& asked) {
  const std::string name = self.full_name(asked);
  const Hdf5Column column = self.reader().column(name);
  const std::uint64_t rows = self.rows(name);
  const std::vector<double> numbers = self.reader().numbers(name, rows);
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(rows)};
  shape.insert(shape.end(), column.row_shape.begin(), column.row_shape.end());
  switch (column.type) {
    case Hdf5Type::kFloat64:
      return converted<double>(numbers, shape);
    case Hdf5Type::kFloat32:
      return converted<float>(numbers, shape);
    case Hdf5Type::kInt32:
      return converted<std::int32_t>(numbers, shape);
    case Hdf5Type::kUint8:
      return converted<std::uint8_t>(numbers, shape);
    case Hdf5Type::kUint32:
      return converted<std::uint32_t>(numbers, shape);
    case Hdf5Type::kUint64:
      return converted<std::uint64_t>(numbers, shape);
  }
  return converted<double>(numbers, shape);
}

std::vector<std::string> columns(const Recording& self) {
  std::vector<std::string> names = self.reader().columns();
  for (std::string& name : names) {
    name.erase(0, 1);
  }
  return names;
}

template <auto kMember>
auto header_field() {
  return [](const Recording& self) { return self.header().*kMember; };
}

void add_facts(py::class_<Recording>& type) {
  type.def_property_readonly("version", header_field<&RecordingHeader::version>(),
                             "Version of forcegrid that wrote it.")
      .def_property_readonly("profile", header_field<&RecordingHeader::profile>(),
                             "The device's profile, by name.")
      .def_property_readonly("scene", header_field<&RecordingHeader::scene>(),
                             "The scene; empty: another program simulated.")
      .def_property_readonly("method_names", header_field<&RecordingHeader::method_names>(),
                             "The methods, the rendered one first.")
      .def_property_readonly("rate_Hz", header_field<&RecordingHeader::rate_Hz>())
      .def_property_readonly("cycles", header_field<&RecordingHeader::cycles>(),
                             "Rows of every column of cycles/.")
      .def_property_readonly("samples", header_field<&RecordingHeader::samples>(),
                             "Rows of every column of samples/.")
      .def_property_readonly("complete", header_field<&RecordingHeader::complete>(),
                             "Whether its writer closed it; False after a kill.")
      .def_property_readonly("has_reference", header_field<&RecordingHeader::has_reference>(),
                             "Whether it holds reference forces (truth/).")
      .def_property_readonly("file", [](const Recording& self) { return self.reader().file(); });
}

}  // namespace

void bind_recordings(py::module_& module) {
  py::class_<Recording> type(
      module, "Recording",
      R"(A recording of `forcegrid record` or `forcegrid run --record`, column by column.

    with forcegrid.Recording("run.h5") as run:
        t, p = run["cycles/time_s"], run["cycles/position_W_m"]

The columns and their units: docs/recording.md. A file that is still written, or whose writer was
killed, can be read, too.)");
  type.def(py::init<const std::string&>(), py::arg("file"),
           "Raises RecordingError naming file and reason.");
  add_facts(type);
  type.def_property_readonly("columns", &columns, "Names of the columns: [\"cycles/age_ms\", ...].")
      .def(
          "__getitem__", &column, py::arg("column"),
          R"(A column as a new array, shape (rows,) or (rows, ...), with the type that the file has.

column: "cycles/time_s"; "cycles/" may be left out. Raises KeyError for an unknown name.)")
      .def(
          "__contains__",
          [](const Recording& self, const std::string& name) {
            const std::vector<std::string> all = columns(self);
            return std::find(all.begin(), all.end(), name) != all.end();
          },
          py::arg("column"))
      .def(
          "meaning",
          [](const Recording& self, const std::string& name) {
            return self.reader().column(self.full_name(name)).meaning;
          },
          py::arg("column"), "What a column holds, in words.")
      .def(
          "attribute",
          [](const Recording& self, const std::string& name) {
            return self.reader().attribute(name);
          },
          py::arg("name"), "A text of the file, e.g. \"settings\"; empty if there is none.")
      .def("close", &Recording::close, "Closes the file; the arrays stay.")
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](Recording& self, const py::args&) { self.close(); })
      .def("__repr__", [](const Recording& self) {
        return "<forcegrid.Recording of " + std::to_string(self.header().cycles) + " cycles>";
      });
}

}  // namespace forcegrid::python
