// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/methods.h"

#include <pybind11/stl.h>

#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "bindings/python/guarded.h"
#include "forcegrid/method_variant.h"

namespace forcegrid::python {
namespace {

constexpr int kAllWork = 1 << 30;
constexpr double kDefaultHalfSide_m = 0.1;
constexpr int kDefaultCells = 49;
constexpr std::size_t kFewQueries = 16;  // fewer are over before another thread could begin

py::handle status_type;  // never given up: it may outlive the interpreter

// What estimate() returns: numbers for one position, arrays for several.
struct Estimate {
  py::object force_W;
  py::object status;
  py::object uncertainty_N;
  py::object candidate;
};

GridGeometry workspace_of(const py::object& workspace_m, const py::object& cells) {
  GridGeometry grid;
  grid.min_W.setConstant(-kDefaultHalfSide_m);
  grid.max_W.setConstant(kDefaultHalfSide_m);
  grid.cells.setConstant(kDefaultCells);
  if (!workspace_m.is_none()) {
    const Vectors corners(workspace_m, "workspace_W_m");
    if (corners.single() || corners.count() != 2) {
      throw py::value_error(
          "workspace_W_m: expected shape (2, 3), the lowest and the highest corner");
    }
    grid.min_W = corners[0];
    grid.max_W = corners[1];
  }
  if (!cells.is_none()) {
    const Doubles given = doubles_of(cells, "cells", "() or (3,)");
    if (given.size() != 1 && given.size() != 3) {
      throw py::value_error("cells: expected a number or shape (3,), got " + shape_text(given));
    }
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const double count = given.data()[given.size() == 1 ? 0 : axis];
      if (!(count >= 1.0 && count <= 4096.0 && count == std::floor(count))) {
        throw py::value_error("cells: expected whole numbers of 1 to 4096");
      }
      grid.cells[axis] = static_cast<int>(count);
    }
  }
  try {
    grid.check();
  } catch (const std::invalid_argument& error) {
    throw py::value_error(std::string("workspace_W_m: ") + error.what());
  }
  return grid;
}

// A force method that Python's threads share.
class Method {
 public:
  Method(const std::string& name, const py::object& workspace_m, const py::object& cells,
         const py::kwargs& options) {
    MethodOptions base;
    base.grid = workspace_of(workspace_m, cells);
    text_ = name;
    for (const auto& [key, value] : options) {
      text_ += ' ';
      text_ += py::str(key).cast<std::string>();
      text_ += '=';
      text_ += py::str(value).cast<std::string>();
    }
    const MethodVariant variant = parse_method_variant(text_, base);
    method_ = make_force_method(variant.name, variant.options);
    text_ = variant.text;
  }

  // Calls call(method) alone: see Guard.
  template <typename Call>
  auto alone(Call call) {
    return guard_.alone([&] { return call(*method_); });
  }
  template <typename Call>
  auto without_gil(Call call) {
    return guard_.without_gil([&] { return call(*method_); });
  }

  template <typename Call>
  void for_queries(std::size_t count, Call call) {
    if (count < kFewQueries) {
      alone(call);
    } else {
      without_gil(call);
    }
  }

  [[nodiscard]] const std::string& text() const { return text_; }
  [[nodiscard]] const ForceMethod& method() const { return *method_; }

  std::uint32_t epoch = 0;  // of the present contact

 private:
  std::string text_;
  std::unique_ptr<ForceMethod> method_;
  Guard guard_;
};

py::array_t<double> result_in(const py::object& out, const Vectors& positions) {
  const std::vector<py::ssize_t> shape = positions.shape_with({3});
  if (out.is_none()) {
    return array_of<double>(shape);
  }
  if (!py::isinstance<py::array_t<double>>(out)) {
    throw py::type_error("out: expected an array of float64");
  }
  auto array = py::reinterpret_borrow<py::array_t<double>>(out);
  const bool same_shape = array.ndim() == static_cast<py::ssize_t>(shape.size()) &&
                          std::equal(shape.begin(), shape.end(), array.shape());
  if (!same_shape || (array.flags() & py::array::c_style) == 0 || !array.writeable()) {
    throw py::value_error("out: expected a writeable, contiguous array of the positions' shape");
  }
  return array;
}

// All by value, which the compiler keeps in registers: writing a force could change what is behind
// a reference.
void fill_forces(const ForceMethod& method, Times::View times, const double* from,
                 std::size_t count, double* to) {
  const double* const end = from + 3 * count;
  if (times.step == 0 && count > 0) {
    for (const double time_s = times[0]; from != end; from += 3, to += 3) {
      Eigen::Vector3d::Map(to) = method.force(time_s, Eigen::Vector3d::Map(from)).force_W;
    }
    return;
  }
  for (const double* time_s = times.data; from != end; from += 3, to += 3, ++time_s) {
    Eigen::Vector3d::Map(to) = method.force(*time_s, Eigen::Vector3d::Map(from)).force_W;
  }
}

py::array_t<double> force(Method& self, const py::object& time_s, const py::object& position_W_m,
                          const py::object& out) {
  const Vectors positions(position_W_m, "position_W_m");
  const Times given(time_s, "time_s", positions.count());
  const Times::View times = given.view();
  py::array_t<double> forces = result_in(out, positions);
  double* const to = forces.mutable_data();
  const std::size_t count = positions.count();
  self.for_queries(count, [&](const ForceMethod& method) {
    fill_forces(method, times, positions.data(), count, to);
  });
  return forces;
}

py::object candidate_name(const ForceMethod& method, std::uint8_t candidate) {
  const auto names = method.candidates();
  return candidate < names.size() ? py::object(py::str(names[candidate])) : py::none();
}

Estimate estimate(Method& self, const py::object& time_s, const py::object& position_W_m) {
  const Vectors positions(position_W_m, "position_W_m");
  const Times times(time_s, "time_s", positions.count());
  if (positions.single()) {
    const ForceEstimate one =
        self.alone([&](const ForceMethod& method) { return method.force(times[0], positions[0]); });
    return {array_from(std::array<double, 3>{one.force_W.x(), one.force_W.y(), one.force_W.z()}),
            status_type(static_cast<int>(one.status)), py::float_(one.uncertainty_N),
            candidate_name(self.method(), one.candidate)};
  }
  const std::size_t count = positions.count();
  const auto rows = static_cast<py::ssize_t>(count);
  auto forces = array_of<double>({rows, 3});
  auto statuses = array_of<std::uint8_t>({rows});
  auto uncertainties = array_of<double>({rows});
  auto candidates = array_of<std::uint8_t>({rows});
  double* const to_force = forces.mutable_data();
  std::uint8_t* const to_status = statuses.mutable_data();
  double* const to_uncertainty = uncertainties.mutable_data();
  std::uint8_t* const to_candidate = candidates.mutable_data();
  self.for_queries(count, [&](const ForceMethod& method) {
    for (std::size_t i = 0; i < count; ++i) {
      const ForceEstimate one = method.force(times[i], positions[i]);
      Eigen::Map<Eigen::Vector3d>(to_force + 3 * i) = one.force_W;
      to_status[i] = static_cast<std::uint8_t>(one.status);
      to_uncertainty[i] = one.uncertainty_N;
      to_candidate[i] = one.candidate;
    }
  });
  return {forces, statuses, uncertainties, candidates};
}

void take_sample(Method& self, double time_s, const py::object& position_W_m,
                 const py::object& force_W_N, const py::object& stiffness_W_N_per_m,
                 const py::object& contact_point_W_m, bool from_query, bool before_contact) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = vector_of(position_W_m, "position_W_m");
  sample.force_W = vector_of(force_W_N, "force_W_N");
  if (!stiffness_W_N_per_m.is_none()) {
    sample.has_stiffness = true;
    const std::array<double, 9> rows = nine_of(stiffness_W_N_per_m, "stiffness_W_N_per_m");
    sample.stiffness_W =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
  }
  sample.contact_epoch = self.epoch;
  sample.contact_point_W = contact_point_W_m.is_none()
                               ? sample.position_W
                               : vector_of(contact_point_W_m, "contact_point_W_m");
  sample.from_query = from_query;
  sample.before_contact = before_contact;
  self.alone([&](ForceMethod& method) { method.take_sample(sample); });
}

void take_samples(Method& self, const py::object& time_s, const py::object& position_W_m,
                  const py::object& force_W_N) {
  const Vectors positions(position_W_m, "position_W_m");
  const Vectors forces(force_W_N, "force_W_N");
  if (forces.count() != positions.count()) {
    throw py::value_error("force_W_N: expected " + std::to_string(positions.count()) +
                          " forces, one for each position, got " + std::to_string(forces.count()));
  }
  const Times times(time_s, "time_s", positions.count());
  const std::uint32_t epoch = self.epoch;
  self.without_gil([&](ForceMethod& method) {
    for (std::size_t i = 0; i < positions.count(); ++i) {
      Sample sample;
      sample.time_s = times[i];
      sample.position_W = positions[i];
      sample.force_W = forces[i];
      sample.contact_epoch = epoch;
      sample.contact_point_W = sample.position_W;
      method.observe(sample.time_s, sample.position_W);
      method.take_sample(sample);
      method.work(kAllWork);
    }
  });
}

py::dict counters(Method& self) {
  std::vector<NamedCounter> counted;
  self.alone([&](const ForceMethod& method) {
    counted.assign(method.counters().begin(), method.counters().end());
  });
  py::dict named;
  for (const NamedCounter& counter : counted) {
    named[counter.name] = counter.value;
  }
  return named;
}

py::dict needs(const Method& self) {
  const MethodNeeds needs = self.method().needs();
  py::dict named;
  named["stiffness"] = needs.stiffness;
  named["requests"] = needs.requests;
  named["requests_before_contact"] = needs.requests_before_contact;
  return named;
}

py::tuple candidates(const Method& self) {
  py::list names;
  for (const char* const name : self.method().candidates()) {
    names.append(name);
  }
  return py::tuple(names);
}

py::object plan_request(Method& self, double time_s, const py::object& position_W_m) {
  const Eigen::Vector3d position_W = vector_of(position_W_m, "position_W_m");
  Eigen::Vector3d wanted_W = Eigen::Vector3d::Zero();
  const bool wanted = self.alone(
      [&](ForceMethod& method) { return method.plan_request(time_s, position_W, wanted_W); });
  return wanted ? py::object(
                      array_from(std::array<double, 3>{wanted_W.x(), wanted_W.y(), wanted_W.z()}))
                : py::none();
}

std::uint32_t contact_made(Method& self, const py::object& point_W_m,
                           std::optional<std::uint32_t> epoch) {
  const Eigen::Vector3d point_W =
      point_W_m.is_none()
          ? Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()).eval()
          : vector_of(point_W_m, "point_W_m");
  self.epoch = epoch.value_or(self.epoch + 1);
  self.alone([&](ForceMethod& method) { method.contact_made(self.epoch, point_W); });
  return self.epoch;
}

int work(Method& self, std::optional<int> budget) {
  return self.without_gil(
      [&](ForceMethod& method) { return method.work(budget.value_or(kAllWork)); });
}

void add_queries(py::class_<Method>& type) {
  type.def("force", &force, py::arg("time_s"), py::arg("position_W_m"), py::arg("out") = py::none(),
           R"(The force of the object on the tool.

time_s: [s] number, or shape (n,). position_W_m: [m] shape (3,) or (n, 3), frame W.
out: a float64 array of the positions' shape to write into, which saves an allocation.
Returns [N] an array of the positions' shape, frame W; zero where the status is not OK or
PARTLY_KNOWN. Releases the GIL for many positions. Raises ValueError for another shape.)");
  type.def("estimate", &estimate, py::arg("time_s"), py::arg("position_W_m"),
           R"(The force with all that the method knows about it, an Estimate.

Arguments as force(). For one position the Estimate holds numbers, for (n, 3) arrays.)");
  type.def("plan_request", &plan_request, py::arg("time_s"), py::arg("position_W_m"),
           R"(Where a method with needs["requests"] asks the simulator next.

Returns [m] shape (3,), frame W, or None. Give the answer to take_sample(from_query=True).)");
}

void add_learning(py::class_<Method>& type) {
  type.def("contact_made", &contact_made, py::arg("point_W_m") = py::none(),
           py::arg("epoch") = py::none(),
           R"(The tool touched an object: what was learnt before may no longer hold.

point_W_m: [m] shape (3,), frame W, where it touched; None: unknown. epoch: the contact's number;
None: one more than the last. Returns the epoch, which the samples that follow carry.)");
  type.def(
      "contact_lost",
      [](Method& self) { self.alone([](ForceMethod& method) { method.contact_lost(); }); },
      "The tool came off the object: the force is zero until the next contact_made().");
  type.def("take_sample", &take_sample, py::arg("time_s"), py::arg("position_W_m"),
           py::arg("force_W_N"), py::arg("stiffness_W_N_per_m") = py::none(), py::kw_only(),
           py::arg("contact_point_W_m") = py::none(), py::arg("from_query") = false,
           py::arg("before_contact") = false,
           R"(Takes one answer of a simulator, or keeps it for work().

time_s: [s] when the tool was there. position_W_m, force_W_N: shape (3,), frame W; the force is that
of the object on the tool. stiffness_W_N_per_m: dF/dP, shape (3, 3). Samples that are not finite or
older than the newest are ignored.)");
  type.def("take_samples", &take_samples, py::arg("time_s"), py::arg("position_W_m"),
           py::arg("force_W_N"),
           R"(Takes many samples in their order, as a loop with time for all work would.

For each: observe(), take_sample(), work(). time_s: shape (n,); position_W_m, force_W_N: shape
(n, 3). Releases the GIL.)");
  type.def(
      "observe",
      [](Method& self, double time_s, const py::object& position_W_m) {
        const Eigen::Vector3d position_W = vector_of(position_W_m, "position_W_m");
        self.alone([&](ForceMethod& method) { method.observe(time_s, position_W); });
      },
      py::arg("time_s"), py::arg("position_W_m"),
      "The tool's time [s] and position [m], shape (3,), frame W; once per servo cycle before "
      "force().");
  type.def(
      "expect_contact",
      [](Method& self, double time_s, const py::object& point_W_m) {
        const Eigen::Vector3d point_W = vector_of(point_W_m, "point_W_m");
        self.alone([&](ForceMethod& method) { method.expect_contact(time_s, point_W); });
      },
      py::arg("time_s"), py::arg("point_W_m"),
      "The tool in the air will touch at point_W_m [m], shape (3,), within some tenths of a "
      "second.");
  type.def("work", &work, py::arg("budget") = py::none(),
           R"(Does pending work of at most `budget` units; None: all of it.

A unit is the update of one vertex of a grid; a servo cycle gives 1000. Returns the units done.
Releases the GIL.)");
}

}  // namespace

void bind_methods(py::module_& module) {
  status_type =
      int_enum(module, "Status", "What a method knows about a force.",
               {{"OK", 0}, {"PARTLY_KNOWN", 1}, {"UNKNOWN", 2}, {"OUTSIDE", 3}, {"NOT_FINITE", 4}})
          .release();

  py::class_<Estimate>(module, "Estimate",
                       R"(A force and what the method knows about it.

force_W: [N] shape (3,) or (n, 3), frame W. status: a Status, or uint8 of shape (n,).
uncertainty_N: one standard deviation of the force's error, NaN for a method that doesn't know it.
candidate: name of the rendered candidate or None, or uint8 indices into Method.candidates.)")
      .def_readonly("force_W_N", &Estimate::force_W)
      .def_readonly("status", &Estimate::status)
      .def_readonly("uncertainty_N", &Estimate::uncertainty_N)
      .def_readonly("candidate", &Estimate::candidate)
      .def("__repr__", [](const Estimate& self) {
        return py::str("Estimate(force_W_N={}, status={!r}, uncertainty_N={})")
            .format(self.force_W, self.status, self.uncertainty_N);
      });

  py::class_<Method> type(module, "Method",
                          R"(A force method: it learns from samples and gives a force anywhere.

Made by make(). Frame W is the workspace's; SI units; forces are those of the object on the tool.
Threads: any; calls wait for each other.)");
  type.def_property_readonly("name", [](const Method& self) { return self.method().name(); })
      .def_property_readonly("text", &Method::text, "The name with the options, as given.")
      .def_property_readonly("memory_bytes",
                             [](const Method& self) { return self.method().memory_bytes(); })
      .def_property_readonly("needs", &needs, "What it needs from a simulator beyond forces: dict.")
      .def_property_readonly("candidates", &candidates,
                             "Names of the fields between which it chooses; () if there is none.")
      .def_property_readonly("counters", &counters,
                             "What it has counted, e.g. samples that it could not use: dict.")
      .def("__repr__", [](const Method& self) { return "<forcegrid.Method " + self.text() + ">"; });
  add_learning(type);
  add_queries(type);

  module.def(
      "make",
      [](const std::string& name, const py::object& workspace_W_m, const py::object& cells,
         const py::kwargs& options) {
        return std::make_unique<Method>(name, workspace_W_m, cells, options);
      },
      py::arg("name") = kDefaultMethod, py::arg("workspace_W_m") = py::none(),
      py::arg("cells") = py::none(),
      R"(Makes a force method by its name, e.g. make("auto") or make("forcegrid", unit="m").

name: one of method_names(), also with its options as on the command line: "forcegrid unit=m s=3".
workspace_W_m: [m] shape (2, 3), the lowest and highest corner, for the grid methods; by default a
cube of 0.2 m about the origin. cells: of the grid, a number or shape (3,); 49.
options: e.g. r="30mm", samples=16, spacing="1mm", budget=200 (docs/methods.md).
Raises ValueError naming the word that can't be used, and the known ones.)");
  module.def("method_names", &method_names, "The names that make() knows.");
}

}  // namespace forcegrid::python
