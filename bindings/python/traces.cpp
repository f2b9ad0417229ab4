// SPDX-License-Identifier: Apache-2.0
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "evaluation/judge/judge.h"
#include "evaluation/traces/trace.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "tools/hdf5_file.h"
#include "tools/recording.h"

namespace forcegrid::python {
namespace {

using evaluation::DeliveredSample;
using evaluation::ServoInstant;
using evaluation::Trace;
using evaluation::TraceError;
using evaluation::Verdict;

template <typename Row, typename Get>
py::array_t<double> numbers_of(const std::vector<Row>& rows, Get get) {
  auto array = array_of<double>({static_cast<py::ssize_t>(rows.size())});
  std::transform(rows.begin(), rows.end(), array.mutable_data(), get);
  return array;
}

template <typename Row, typename Get>
py::array_t<double> vectors_of(const std::vector<Row>& rows, Get get) {
  auto array = array_of<double>({static_cast<py::ssize_t>(rows.size()), 3});
  double* to = array.mutable_data();
  for (const Row& row : rows) {
    Eigen::Map<Eigen::Vector3d> vector(to);
    vector = get(row);
    to += 3;
  }
  return array;
}

void require_same_count(const Vectors& vectors, const char* name, std::size_t count) {
  if (vectors.count() != count) {
    throw py::value_error(std::string(name) + ": expected " + std::to_string(count) +
                          " rows, got " + std::to_string(vectors.count()));
  }
}

void require_finite(bool finite, const char* name, std::size_t row) {
  if (!finite) {
    throw py::value_error(std::string(name) + ": row " + std::to_string(row) + " is not finite");
  }
}

std::vector<DeliveredSample> samples_of(const py::object& time_s, const py::object& position_W_m,
                                        const py::object& force_W_N, const py::object& delivered_s,
                                        const py::object& stiffness_W_N_per_m) {
  const Vectors positions(position_W_m, "sample_position_W_m");
  const Vectors forces(force_W_N, "sample_force_W_N");
  const std::size_t count = positions.count();
  require_same_count(forces, "sample_force_W_N", count);
  const Times times(time_s, "sample_time_s", count);
  const Times arrivals(delivered_s.is_none() ? time_s : delivered_s, "sample_delivered_s", count);
  Doubles stiffness;
  if (!stiffness_W_N_per_m.is_none()) {
    stiffness = doubles_of(stiffness_W_N_per_m, "sample_stiffness_W_N_per_m", "(n, 3, 3)");
    if (static_cast<std::size_t>(stiffness.size()) != 9 * count) {
      throw py::value_error("sample_stiffness_W_N_per_m: expected shape (" + std::to_string(count) +
                            ", 3, 3), got " + shape_text(stiffness));
    }
  }
  std::vector<DeliveredSample> samples(count);
  for (std::size_t i = 0; i < count; ++i) {
    Sample& sample = samples[i].sample;
    sample.time_s = times[i];
    sample.position_W = positions[i];
    sample.force_W = forces[i];
    samples[i].delivered_s = arrivals[i];
    require_finite(sample.position_W.allFinite() && sample.force_W.allFinite(),
                   "sample_position_W_m or sample_force_W_N", i);
    if (!(arrivals[i] >= times[i])) {
      throw py::value_error("sample_delivered_s: row " + std::to_string(i) +
                            " arrives before its sample_time_s");
    }
    if (!stiffness_W_N_per_m.is_none()) {
      sample.has_stiffness = true;
      sample.stiffness_W =
          Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(stiffness.data() + 9 * i);
    }
  }
  std::stable_sort(samples.begin(), samples.end(),
                   [](const auto& a, const auto& b) { return a.delivered_s < b.delivered_s; });
  return samples;
}

std::vector<ServoInstant> servo_of(const py::object& time_s, const py::object& position_W_m,
                                   const py::object& force_W_N) {
  const Vectors positions(position_W_m, "servo_position_W_m");
  const Vectors forces(force_W_N, "servo_force_W_N");
  const std::size_t count = positions.count();
  require_same_count(forces, "servo_force_W_N", count);
  const Times times(time_s, "servo_time_s", count);
  if (count == 0) {
    throw py::value_error("servo_position_W_m: expected at least one row");
  }
  std::vector<ServoInstant> servo(count);
  for (std::size_t i = 0; i < count; ++i) {
    servo[i] = {times[i], positions[i], forces[i]};
    require_finite(servo[i].position_W.allFinite() && servo[i].force_W.allFinite(),
                   "servo_position_W_m or servo_force_W_N", i);
    if (i > 0 && !(times[i] > times[i - 1])) {
      throw py::value_error("servo_time_s: has to rise; row " + std::to_string(i) + " doesn't");
    }
  }
  return servo;
}

Trace read_any_trace(const std::string& file) {
  return tools::is_recording_name(file) ? tools::trace_of_recording(file, nullptr)
                                        : evaluation::read_trace(file);
}

GridGeometry workspace_for(const Trace& trace, const py::object& workspace_W_m) {
  GridGeometry grid = evaluation::default_trace_workspace();
  if (workspace_W_m.is_none()) {
    return evaluation::positions_outside(grid, trace) > 0 ? evaluation::box_around(trace) : grid;
  }
  const Vectors corners(workspace_W_m, "workspace_W_m");
  if (corners.single() || corners.count() != 2) {
    throw py::value_error("workspace_W_m: expected shape (2, 3), the lowest and highest corner");
  }
  grid.min_W = corners[0];
  grid.max_W = corners[1];
  grid.check();
  return grid;
}

std::unique_ptr<ForceMethod> method_for(const MethodVariant& variant, const Trace& trace,
                                        bool stiffness) {
  std::unique_ptr<ForceMethod> method = make_force_method(variant.name, variant.options);
  const MethodNeeds needs = method->needs();
  if (needs.requests) {
    throw py::value_error("method '" + variant.text +
                          "' requests forces at positions that it chooses, which a trace can't "
                          "answer; use 'forcegrid chart accuracy'");
  }
  const bool has = std::any_of(trace.samples.begin(), trace.samples.end(),
                               [](const auto& row) { return row.sample.has_stiffness; });
  if (needs.stiffness && !(stiffness && has)) {
    throw py::value_error("method '" + variant.text +
                          "' needs the samples' stiffness, which the trace does not have or "
                          "stiffness=False hides");
  }
  return method;
}

// With the keys of `forcegrid evaluate`.
py::dict figures_of(const Verdict& v, const ForceMethod& method) {
  py::dict figures;
  const auto set = [&](const char* key, const auto& value) { figures[key] = value; };
  set("rms_error_percent_after_1s", v.rms_error_percent_after_1s);
  set("rms_error_percent_first_1s", v.rms_error_percent_first_1s);
  set("p95_error_percent_after_1s", v.p95_error_percent_after_1s);
  set("p95_error_percent_first_1s", v.p95_error_percent_first_1s);
  set("max_error_percent_after_1s", v.max_error_percent_after_1s);
  set("max_error_percent_first_1s", v.max_error_percent_first_1s);
  set("adaptation_s", v.adaptation_s);
  set("largest_step_N", v.largest_step_N);
  set("reference_rms_N", v.reference_rms_N);
  set("query_ns_median", v.query_ns_median);
  set("query_ns_p99", v.query_ns_p99);
  set("sample_us_median", v.sample_us_median);
  set("sample_us_p99", v.sample_us_p99);
  set("cycle_ns", v.cycle_ns);
  set("cycle_ns_median", v.cycle_ns_median);
  set("cycle_ns_p99", v.cycle_ns_p99);
  set("cycle_ns_p999", v.cycle_ns_p999);
  set("timer_floor_ns", v.timer_floor_ns);
  set("memory_bytes", v.memory_bytes);
  set("samples_taken", v.samples_taken);
  set("samples_not_taken", v.samples_not_taken);
  set("samples_refused", v.samples_refused);
  constexpr std::array<const char*, 5> kCycles = {"cycles_known", "cycles_partly_known",
                                                  "cycles_unknown", "cycles_outside_workspace",
                                                  "cycles_not_finite"};
  for (std::size_t i = 0; i < kCycles.size(); ++i) {
    set(kCycles[i], v.cycles_by_status[i]);
  }
  py::dict counters;
  for (const NamedCounter& counter : method.counters()) {
    counters[counter.name] = counter.value;
  }
  figures["counters"] = counters;
  return figures;
}

py::dict evaluate(const std::string& name, const py::object& trace_or_file,
                  const py::object& workspace_W_m, int work_budget, bool stiffness, bool forces) {
  Trace read;
  if (!py::isinstance<Trace>(trace_or_file)) {
    read = read_any_trace(py::str(trace_or_file).cast<std::string>());
  }
  const Trace& trace =
      py::isinstance<Trace>(trace_or_file) ? trace_or_file.cast<const Trace&>() : read;
  MethodOptions base;
  base.grid = workspace_for(trace, workspace_W_m);
  const auto method = method_for(parse_method_variant(name, base), trace, stiffness);
  evaluation::JudgeOptions options;
  options.work_budget = work_budget;
  options.stiffness_to_method = stiffness;
  options.keep_forces = forces;
  Verdict verdict;
  {
    const py::gil_scoped_release release;
    verdict = evaluation::judge(*method, trace, options);
  }
  py::dict figures = figures_of(verdict, *method);
  if (forces) {
    figures["force_W_N"] = vectors_of(verdict.forces_W, [](const auto& force) { return force; });
  }
  return figures;
}

void add_columns(py::class_<Trace>& type) {
  type.def_property_readonly(
          "sample_time_s",
          [](const Trace& self) {
            return numbers_of(self.samples, [](const auto& row) { return row.sample.time_s; });
          },
          "[s] shape (n,)")
      .def_property_readonly(
          "sample_delivered_s",
          [](const Trace& self) {
            return numbers_of(self.samples, [](const auto& row) { return row.delivered_s; });
          },
          "[s] shape (n,), rising")
      .def_property_readonly(
          "sample_position_W_m",
          [](const Trace& self) {
            return vectors_of(self.samples, [](const auto& row) { return row.sample.position_W; });
          },
          "[m] shape (n, 3)")
      .def_property_readonly(
          "sample_force_W_N",
          [](const Trace& self) {
            return vectors_of(self.samples, [](const auto& row) { return row.sample.force_W; });
          },
          "[N] shape (n, 3)")
      .def_property_readonly(
          "servo_time_s",
          [](const Trace& self) {
            return numbers_of(self.servo, [](const auto& row) { return row.time_s; });
          },
          "[s] shape (m,), rising")
      .def_property_readonly(
          "servo_position_W_m",
          [](const Trace& self) {
            return vectors_of(self.servo, [](const auto& row) { return row.position_W; });
          },
          "[m] shape (m, 3)")
      .def_property_readonly(
          "servo_force_W_N",
          [](const Trace& self) {
            return vectors_of(self.servo, [](const auto& row) { return row.force_W; });
          },
          "[N] the reference force, shape (m, 3)");
}

}  // namespace

void bind_traces(py::module_& module) {
  error_type<TraceError>(module, "TraceError", PyExc_ValueError,
                         "A trace that can't be read or written; names file, row and column.");
  error_type<tools::Hdf5Error>(module, "RecordingError", PyExc_ValueError,
                               "A recording that can't be read; names file, part and reason.");
  py::class_<Trace> type(module, "Trace",
                         R"(Samples of a simulator and the path of a tool, to evaluate methods on.

Frame W; times in seconds of one clock. Made from arrays, or by read_trace(). The properties are
copies.)");
  type.def(py::init([](const py::object& sample_time_s, const py::object& sample_position_W_m,
                       const py::object& sample_force_W_N, const py::object& servo_time_s,
                       const py::object& servo_position_W_m, const py::object& servo_force_W_N,
                       const py::object& sample_delivered_s,
                       const py::object& sample_stiffness_W_N_per_m) {
             Trace trace;
             trace.samples = samples_of(sample_time_s, sample_position_W_m, sample_force_W_N,
                                        sample_delivered_s, sample_stiffness_W_N_per_m);
             trace.servo = servo_of(servo_time_s, servo_position_W_m, servo_force_W_N);
             return trace;
           }),
           py::kw_only(), py::arg("sample_time_s"), py::arg("sample_position_W_m"),
           py::arg("sample_force_W_N"), py::arg("servo_time_s"), py::arg("servo_position_W_m"),
           py::arg("servo_force_W_N"), py::arg("sample_delivered_s") = py::none(),
           py::arg("sample_stiffness_W_N_per_m") = py::none(),
           R"(One contact, made at the first sample.

sample_time_s: [s] shape (n,), when each force was computed. sample_position_W_m, sample_force_W_N:
shape (n, 3). sample_delivered_s: when it arrived; None: at once. sample_stiffness_W_N_per_m: dF/dP,
shape (n, 3, 3). servo_time_s: [s] shape (m,), rising; servo_position_W_m and servo_force_W_N, the
reference force: shape (m, 3). Raises ValueError naming the array.)");
  add_columns(type);
  type.def(
      "write",
      [](const Trace& self, const std::string& file) { evaluation::write_trace(file, self); },
      py::arg("file"),
      "Writes a CSV file (docs/traces.md), gzipped if the name ends in .gz. Raises TraceError.");
  module.def("read_trace", &read_any_trace, py::arg("file"),
             R"(Reads a trace (.csv, .csv.gz) or a recording with reference forces (.h5).

Raises TraceError or RecordingError naming file, row and column.)");
  module.def("evaluate", &evaluate, py::arg("method"), py::arg("trace"), py::kw_only(),
             py::arg("workspace_W_m") = py::none(), py::arg("work_budget") = -1,
             py::arg("stiffness") = true, py::arg("forces") = false,
             R"(Errors and costs of a force method on a trace, as `forcegrid evaluate` prints them.

method: a name, with options as in make(). trace: a Trace or a file. workspace_W_m: [m] shape (2, 3)
for grid methods; None: as the command chooses it. work_budget: units of Method.work() in each
cycle; negative: all at once after each sample. stiffness: False hides dF/dP from the method.
Returns a dict with the command's keys (docs/traces.md), errors in percent of the RMS reference
force; with forces=True also "force_W_N" [N], shape (m, 3). Releases the GIL.)");
}

}  // namespace forcegrid::python
