// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

/// Arrays that come from Python and go there. A message names the argument and the shape that it
/// has to have. None of this needs NumPy before the first array: importing the module stays quick.
namespace forcegrid::python {

namespace py = pybind11;

/// Contiguous doubles: an array that has them already is not copied.
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// The numbers of `value`, of any shape. @throws ValueError naming `name`.
inline Doubles doubles_of(const py::handle& value, const char* name, const char* wanted) {
  Doubles array = Doubles::ensure(value);
  if (!array) {
    throw py::value_error(std::string(name) + ": expected numbers of shape " + wanted);
  }
  return array;
}

/// "(4, 2)" for messages.
inline std::string shape_text(const py::array& array) {
  std::string text = "(";
  for (py::ssize_t i = 0; i < array.ndim(); ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(array.shape(i));
  }
  return text + (array.ndim() == 1 ? ",)" : ")");
}

/// One vector, or several.
class Vectors {
 public:
  /// @throws ValueError unless `value` is of shape (3,) or (n, 3).
  Vectors(const py::handle& value, const char* name)
      : array_(doubles_of(value, name, "(3,) or (n, 3)")) {
    if (!(array_.ndim() == 1 && array_.shape(0) == 3) &&
        !(array_.ndim() == 2 && array_.shape(1) == 3)) {
      throw py::value_error(std::string(name) + ": expected shape (3,) or (n, 3), got " +
                            shape_text(array_));
    }
  }

  [[nodiscard]] bool single() const { return array_.ndim() == 1; }
  [[nodiscard]] std::size_t count() const {
    return single() ? 1 : static_cast<std::size_t>(array_.shape(0));
  }
  /// Needs no GIL.
  [[nodiscard]] const double* data() const { return data_; }
  [[nodiscard]] Eigen::Map<const Eigen::Vector3d> operator[](std::size_t i) const {
    return Eigen::Map<const Eigen::Vector3d>(data_ + 3 * i);
  }
  /// The shape of a result with `row` for each vector: `row`, or (n, row...).
  [[nodiscard]] std::vector<py::ssize_t> shape_with(std::vector<py::ssize_t> row) const {
    if (!single()) {
      row.insert(row.begin(), array_.shape(0));
    }
    return row;
  }

 private:
  Doubles array_;
  const double* data_ = array_.data();
};

/// @throws ValueError unless `value` is of shape (3,).
inline Eigen::Vector3d vector_of(const py::handle& value, const char* name) {
  const Doubles array = doubles_of(value, name, "(3,)");
  if (array.ndim() != 1 || array.shape(0) != 3) {
    throw py::value_error(std::string(name) + ": expected shape (3,), got " + shape_text(array));
  }
  return Eigen::Vector3d(array.at(0), array.at(1), array.at(2));
}

inline std::array<double, 3> three_of(const py::handle& value, const char* name) {
  const Eigen::Vector3d vector = vector_of(value, name);
  return {vector.x(), vector.y(), vector.z()};
}

/// @throws ValueError unless `value` is of shape (3, 3) or has nine numbers, row by row.
inline std::array<double, 9> nine_of(const py::handle& value, const char* name) {
  const Doubles array = doubles_of(value, name, "(3, 3)");
  if (array.size() != 9) {
    throw py::value_error(std::string(name) + ": expected shape (3, 3), got " + shape_text(array));
  }
  std::array<double, 9> nine{};
  std::copy_n(array.data(), 9, nine.begin());
  return nine;
}

/// One time for all of `count` vectors, or one for each.
class Times {
 public:
  /// @throws ValueError unless `value` is a number or of shape (count,).
  Times(const py::handle& value, const char* name, std::size_t count)
      : array_(doubles_of(value, name, "() or (n,)")), step_(array_.ndim() == 0 ? 0 : 1) {
    if (array_.ndim() > 1 ||
        (array_.ndim() == 1 && static_cast<std::size_t>(array_.size()) != count)) {
      throw py::value_error(std::string(name) + ": expected a number or shape (" +
                            std::to_string(count) + ",), got " + shape_text(array_));
    }
  }
  /// The numbers without the array that holds them.
  struct View {
    const double* data;
    std::size_t step;  ///< 0: one time for all
    double operator[](std::size_t i) const { return data[step * i]; }
  };
  [[nodiscard]] View view() const { return {array_.data(), step_}; }
  [[nodiscard]] double operator[](std::size_t i) const { return view()[i]; }

 private:
  Doubles array_;
  std::size_t step_;
};

/// A new array with room for a result. @tparam T of its numbers.
template <typename T>
py::array_t<T> array_of(const std::vector<py::ssize_t>& shape) {
  return py::array_t<T>(shape);
}

/// Shape (3,).
template <typename Vector>
py::array_t<double> array_from(const Vector& vector) {
  py::array_t<double> array(3);
  double* to = array.mutable_data();
  for (int i = 0; i < 3; ++i) {
    to[i] = vector[static_cast<std::size_t>(i)];
  }
  return array;
}

/// Shape (3, 3) of nine numbers, row by row.
inline py::array_t<double> matrix_from(const std::array<double, 9>& nine) {
  py::array_t<double> array(std::vector<py::ssize_t>{3, 3});
  std::copy(nine.begin(), nine.end(), array.mutable_data());
  return array;
}

/// Makes enum.IntEnum `name` of the module: its members compare with the numbers of a status array.
inline py::object int_enum(py::module_& module, const char* name, const char* doc,
                           const std::vector<std::pair<const char*, int>>& members) {
  py::list pairs;
  for (const auto& [member, value] : members) {
    pairs.append(py::make_tuple(member, value));
  }
  py::object type =
      py::module_::import("enum").attr("IntEnum")(name, pairs, py::arg("module") = "forcegrid");
  type.attr("__doc__") = doc;
  module.attr(name) = type;
  return type;
}

/// Makes a Python exception of a C++ one.
template <typename Error>
void error_type(py::module_& module, const char* name, PyObject* base, const char* doc) {
  py::register_exception<Error>(module, name, base).attr("__doc__") = doc;
}

}  // namespace forcegrid::python
