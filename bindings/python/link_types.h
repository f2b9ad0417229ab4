// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <string>

#include "link/messages.h"
#include "link/statistics.h"

namespace forcegrid::python {

namespace py = pybind11;

/// Vectors of the link are tuples: its programs run without NumPy.
inline py::tuple tuple_of(const link::Vector3& vector) {
  return py::make_tuple(vector[0], vector[1], vector[2]);
}

/// The same of a quaternion: w, x, y, z.
inline py::tuple tuple_of(const link::Quaternion& quaternion) {
  return py::make_tuple(quaternion[0], quaternion[1], quaternion[2], quaternion[3]);
}

/// kCount numbers of a sequence, an array, or a sequence of such: rows one after the other. Without
/// NumPy. @throws ValueError naming `name`.
template <std::size_t kCount>
std::array<double, kCount> link_numbers(const py::handle& value, const char* name,
                                        const char* wanted) {
  std::array<double, kCount> numbers{};
  std::size_t count = 0;
  const auto take = [&](const py::handle& number) {
    if (count < kCount) {
      numbers[count] = py::float_(py::reinterpret_borrow<py::object>(number));
    }
    ++count;
  };
  try {
    for (const py::handle& row : py::reinterpret_borrow<py::object>(value)) {
      if (PyFloat_Check(row.ptr()) != 0 || PySequence_Check(row.ptr()) == 0) {
        take(row);
        continue;
      }
      for (const py::handle& number : py::reinterpret_borrow<py::object>(row)) {
        take(number);
      }
    }
  } catch (const py::error_already_set&) {
    count = kCount + 1;
  }
  if (count != kCount) {
    throw py::value_error(std::string(name) + ": expected " + wanted);
  }
  return numbers;
}

inline link::Vector3 link_vector(const py::handle& value, const char* name) {
  return link_numbers<3>(value, name, "three numbers");
}

inline std::chrono::nanoseconds duration_of(double value_s, const char* name) {
  constexpr double kLongest_s = 1e6;
  if (!(value_s >= 0.0)) {
    throw py::value_error(std::string(name) + ": expected a time of 0 s or more");
  }
  return std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * std::min(value_s, kLongest_s)));
}

/// KeyboardInterrupt, if a signal has ended a wait.
inline void raise_for_signals() {
  if (PyErr_CheckSignals() != 0) {
    throw py::error_already_set();
  }
}

inline py::dict dropped_of(const link::LinkStatistics& statistics) {
  py::dict dropped;
  for (const auto& [reason, count] : link::drop_reasons(statistics)) {
    dropped[py::str(reason)] = count;
  }
  return dropped;
}

}  // namespace forcegrid::python
