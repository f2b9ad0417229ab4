// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/evaluate_command.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>

#include "cli/charts/evaluate_output.h"
#include "cli/charts/evaluate_pair.h"
#include "cli/common/budget_option.h"
#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/tools_names.h"
#include "cli/run/reference_forces.h"
#include "evaluation/judge/judge.h"
#include "evaluation/traces/pair_trace.h"
#include "evaluation/traces/trace.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "log/log.h"
#include "simulator/mesh/scene.h"
#include "simulator/reference/reference_solution.h"
#include "tools/recording.h"

namespace forcegrid::cli {
namespace {

using evaluation::Trace;
using evaluation::TraceError;
using evaluation::Verdict;
using nlohmann::ordered_json;

constexpr std::array<std::string_view, 3> kComponents = {"x", "y", "z"};

GridGeometry asked_workspace(const std::vector<double>& corners_m) {
  GridGeometry grid = evaluation::default_trace_workspace();
  if (!corners_m.empty()) {
    grid.min_W = {corners_m.at(0), corners_m.at(1), corners_m.at(2)};
    grid.max_W = {corners_m.at(3), corners_m.at(4), corners_m.at(5)};
  }
  try {
    grid.check();
  } catch (const std::invalid_argument& error) {
    throw UsageError("--workspace: " + std::string(error.what()));
  }
  return grid;
}

// The flags, written as options of a method variant.
std::string flags_as_words(const EvaluateOptions& options) {
  std::string words = " cells=" + options.cells;
  const auto add = [&](const char* key, const std::string& value) {
    if (!value.empty()) {
      words += std::string(" ") + key + "=" + value;
    }
  };
  std::string radius = options.radius;
  if (!radius.empty() &&
      (std::isdigit(static_cast<unsigned char>(radius.back())) != 0 || radius.back() == '.')) {
    radius += "m";
  }
  add("r", radius);
  add("unit", options.unit);
  add("weight", options.weight);
  add("ridge", options.ridge);
  add("s", options.samples_per_cell);
  add("nug", options.nugget);
  return words;
}

// Each method once. The flags come first, so that the method's own options override them.
// `parse` knows the names that the trace can have.
std::vector<NamedVariant> variants_of(const EvaluateOptions& options, const MethodOptions& base,
                                      MethodVariant (*parse)(std::string_view,
                                                             const MethodOptions&)) {
  const std::string flags = flags_as_words(options);
  std::vector<NamedVariant> variants;
  for (const std::string& asked : options.methods) {
    const std::size_t begin = asked.find_first_not_of(" \t");
    const std::size_t end = asked.find_first_of(" \t", begin);
    const std::string name = begin == std::string::npos ? "" : asked.substr(begin, end - begin);
    if (name == "direct") {
      throw UsageError(
          "method 'direct' is the simulator itself, evaluated in every cycle, and a trace holds no "
          "object to evaluate; use 'forcegrid chart accuracy'");
    }
    if (parse == parse_method_variant && is_pair_method(name)) {
      throw UsageError("method '" + name + "' is for two tools, and " + options.trace +
                       " is of one; give a trace with the columns p1x_m to f2z_N");
    }
    const std::string own = end == std::string::npos ? "" : asked.substr(end);
    try {
      const std::string text = parse(asked, base).text;
      const bool known = std::any_of(variants.begin(), variants.end(),
                                     [&](const auto& other) { return other.text == text; });
      if (!known) {
        variants.push_back({text, parse(name + flags + own, base)});
      }
    } catch (const std::invalid_argument& error) {
      throw UsageError(error.what());
    }
  }
  return variants;
}

std::optional<double> asked_budget(const EvaluateOptions& options) {
  try {
    return budget_reads(options.budget, options.methods);
  } catch (const std::runtime_error& error) {
    throw UsageError(error.what());
  }
}

std::unique_ptr<ForceMethod> made(const NamedVariant& named, const EvaluateOptions& options,
                                  const Trace& trace) {
  std::unique_ptr<ForceMethod> method;
  try {
    method = make_force_method(named.variant.name, named.variant.options);
  } catch (const std::invalid_argument& error) {
    throw UsageError("method '" + named.text + "': " + error.what());
  }
  const MethodNeeds needs = method->needs();
  if (needs.requests) {
    throw UsageError("method '" + named.text +
                     "' requests forces at positions that it chooses, which a trace can't answer; "
                     "use 'forcegrid chart accuracy'");
  }
  if (needs.stiffness && options.no_stiffness) {
    throw UsageError("method '" + named.text +
                     "' needs the samples' stiffness; leave out --no-stiffness, or the method");
  }
  if (needs.stiffness && std::none_of(trace.samples.begin(), trace.samples.end(),
                                      [](const auto& row) { return row.sample.has_stiffness; })) {
    throw TraceError(options.trace +
                     ": no sample has a stiffness (columns j00_N_per_m to "
                     "j22_N_per_m), which method '" +
                     named.text + "' needs; choose a method that needs only forces");
  }
  return method;
}

ordered_json json_of(const std::string& text, const Verdict& v, const ForceMethod& method,
                     const GridGeometry& grid) {
  // nlohmann writes NaN, "nothing to measure", as null.
  ordered_json json{{"method", text},
                    {"rms_error_percent_after_1s", v.rms_error_percent_after_1s},
                    {"rms_error_percent_first_1s", v.rms_error_percent_first_1s},
                    {"max_error_percent_after_1s", v.max_error_percent_after_1s},
                    {"query_ns_median", v.query_ns_median},
                    {"sample_us_median", v.sample_us_median},
                    {"memory_bytes", v.memory_bytes},
                    {"p95_error_percent_after_1s", v.p95_error_percent_after_1s},
                    {"p95_error_percent_first_1s", v.p95_error_percent_first_1s},
                    {"max_error_percent_first_1s", v.max_error_percent_first_1s},
                    {"adaptation_s", v.adaptation_s},
                    {"largest_step_N", v.largest_step_N},
                    {"query_ns_p99", v.query_ns_p99},
                    {"sample_us_p99", v.sample_us_p99}};
  add_cycle_costs(json, v);
  json["samples_taken"] = v.samples_taken;
  json["samples_not_taken"] = v.samples_not_taken;
  json["samples_refused"] = v.samples_refused;
  add_counters(json, method.counters(), v.cycles_by_status);
  json["reference_rms_N"] = v.reference_rms_N;
  json["truth_rms_N"] = v.reference_rms_N;
  json["workspace_m"] = json_of_workspace(grid);
  return json;
}

void write_forces(const std::string& file, const Trace& trace,
                  const std::vector<std::string>& names, const std::vector<Verdict>& verdicts) {
  write_force_columns(file, {"", kComponents}, names, trace.servo.size(),
                      [&](std::size_t i, std::vector<double>& numbers) {
                        const auto add = [&](const Eigen::Vector3d& v) {
                          numbers.insert(numbers.end(), v.begin(), v.end());
                        };
                        numbers.push_back(trace.servo[i].time_s);
                        add(trace.servo[i].position_W);
                        add(trace.servo[i].force_W);
                        for (const Verdict& verdict : verdicts) {
                          add(verdict.forces_W[i]);
                        }
                      });
}

std::vector<Eigen::Vector3d> solve_reference(ProgressLine& line, const std::string& scene,
                                             const Eigen::Vector3d& contact_point_W,
                                             const std::vector<Eigen::Vector3d>& positions_W) {
  line.say("Note: the recording has no reference forces; solving scene " + scene + " for them");
  if (moves_by_itself(scene, "auto")) {
    throw std::runtime_error("scene " + scene +
                             " moves by itself, and the recording has no reference forces; record "
                             "it with 'forcegrid run --record FILE.csv.gz'");
  }
  simulator::refuse_sliding_tool(scene, simulator::scene_tool(scene), "a reference force");
  simulator::ReferenceOptions options;
  options.scene = scene;
  options.contact_point_W = contact_point_W;
  options.progress = [&line](double done, double remaining_s) {
    line.show("Reference forces", done, remaining_s);
  };
  return simulator::simulate_reference(positions_W, options).forces_W;
}

void print(const ordered_json& result) {
  std::printf("%s\n", result.dump(2).c_str());
  if (std::fflush(stdout) != 0) {
    throw std::runtime_error(std::string("standard output: ") + std::strerror(errno));
  }
}

void evaluate(const EvaluateOptions& options) {
  MethodOptions base;
  base.grid = asked_workspace(options.workspace_m);
  base.budget_reads = asked_budget(options);
  if (evaluation::is_pair_trace(options.trace)) {
    print(evaluate_pair(options, base, [&options](const MethodOptions& changed) {
      return variants_of(options, changed, parse_pair_variant);
    }));
    return;
  }
  std::vector<NamedVariant> variants = variants_of(
      options, base, parse_method_variant);  // before the trace is read, which may take long
  ProgressLine line;
  line.begin("Reading " + options.trace);
  const Trace trace = tools::is_recording_name(options.trace)
                          ? tools::trace_of_recording(options.trace,
                                                      [&line](const auto&... asked) {
                                                        return solve_reference(line, asked...);
                                                      })
                          : evaluation::read_trace(options.trace);
  line.clear();
  const std::size_t outside = evaluation::positions_outside(base.grid, trace);
  if (outside > 0 && options.workspace_m.empty()) {
    base.grid = evaluation::box_around(trace);
    variants = variants_of(options, base, parse_method_variant);
  } else if (outside > 0) {
    note_of_evaluation(std::to_string(outside) + " of " +
                       std::to_string(trace.servo.size() + trace.samples.size()) +
                       " positions lie outside --workspace, where grid methods have no force");
  }
  if (trace.samples.empty()) {
    note_of_evaluation(options.trace +
                       " has no 'sample' row, so no method learns anything from it");
  }

  evaluation::JudgeOptions judging;
  judging.stiffness_to_method = !options.no_stiffness;
  judging.keep_forces = !options.out.empty();
  if (options.budget.us) {
    judging.work_budget = evaluation::kServoWorkBudget;  // what a budget is about
  }
  const std::vector<std::string> names = texts_of(variants);
  std::vector<Verdict> verdicts;
  const ordered_json result = evaluate_each(names, [&](std::size_t i) {
    const std::unique_ptr<ForceMethod> method = made(variants[i], options, trace);
    verdicts.push_back(judge(*method, trace, judging));
    return json_of(names[i], verdicts.back(), *method, base.grid);
  });
  if (!(verdicts.front().reference_rms_N > 0.0)) {
    note_of_evaluation(options.trace +
                       " has only zero reference forces, so errors have no percentage");
  } else if (trace.servo.back().time_s - trace.servo.front().time_s < 1.0) {
    note_of_evaluation(
        options.trace +
        " is not longer than one second, so the errors after the first second are unknown");
  }
  if (!options.out.empty()) {
    write_forces(options.out, trace, names, verdicts);
  }
  print(result);
}

}  // namespace

void add_evaluate(Command& app, EvaluateOptions& o, std::function<int()>& action) {
  Command& evaluate = app.add_subcommand("evaluate", tools_description("evaluate"));
  evaluate
      .add_option("--method", o.methods,
                  "Force methods, each optionally followed by changes to its options, e.g. "
                  "\"forcegrid unit=m\": " +
                      joined(method_names()) +
                      "; on a trace of two tools these for each tool, or " +
                      joined(pair_method_names()))
      ->required();
  evaluate
      .add_option("--trace", o.trace,
                  "Recording of forcegrid record (.h5), or CSV, gzipped if it ends in .gz: "
                  "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N"
                  "[,j00_N_per_m,...,j22_N_per_m][,residual]; of two tools: "
                  "kind,t_s,delivered_s,p1x_m,...,p2z_m,f1x_N,...,f2z_N"
                  "[,j00_N_per_m,...,j55_N_per_m][,residual]")
      ->required();
  evaluate
      .add_option("--workspace", o.workspace_m,
                  "Box of the grid methods in metres: x0,y0,z0,x1,y1,z1 (default "
                  "0,0,0,0.16,0.12,0.12 if it holds the trace, else its box grown by 30 mm)")
      ->separated_by(',')
      ->values(6)
      ->check(finite_number())
      ->type_name("FLOAT m");
  evaluate.add_option("--cells", o.cells, "Grid cells: X,Y,Z, or one number for all axes")
      ->show_default();
  evaluate.add_option("--r", o.radius,
                      "Radius of influence of a sample: metres, or a length such as 26.7mm "
                      "(default a sixth of the workspace's x extent)");
  evaluate.add_option("--unit", o.unit,
                      "Length unit in the paper's weight: m, mm, cells, or a length such as 2mm "
                      "(default mm)");
  evaluate.add_option("--weight", o.weight,
                      "Weight of a sample over its distance: paper, idw4, idw6 (default the "
                      "method's)");
  evaluate.add_option("--ridge", o.ridge, "Ridge of forcegrid-mls, in r^2");
  evaluate.add_option("--s", o.samples_per_cell, "Samples counted per cell, at most; 0 counts all");
  evaluate.add_option("--nug", o.nugget,
                      "Noise variance per sample of the kriging methods, in N^2");
  add_budget(evaluate, o.budget);
  evaluate.add_flag("--no-stiffness", o.no_stiffness,
                    "Hide the samples' stiffness from the methods");
  evaluate.add_option("--out", o.out,
                      "CSV file for the forces at every servo row; gzipped if it ends in .gz");
  evaluate.callback([&evaluate, &o, &action] {
    o.budget.on_command_line = evaluate.given("--budget-us");
    action = [&o] { return evaluate_command(o); };
  });
}

int evaluate_command(const EvaluateOptions& options) {
  try {
    evaluate(options);
    return 0;
  } catch (const UsageError& error) {
    log::error("command", error.what());
    return 2;
  }
}

}  // namespace forcegrid::cli
