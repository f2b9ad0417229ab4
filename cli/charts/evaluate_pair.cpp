// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/evaluate_pair.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/common/progress_line.h"
#include "evaluation/judge.h"
#include "evaluation/pair_judge.h"
#include "evaluation/pair_trace.h"
#include "evaluation/text_file.h"
#include "evaluation/trace_workspace.h"
#include "forcegrid/pair_methods.h"
#include "log/log.h"

namespace forcegrid::cli {
namespace {

using evaluation::PairErrors;
using evaluation::PairTrace;
using evaluation::PairVerdict;
using nlohmann::ordered_json;

constexpr const char* kComponents[6] = {"1x", "1y", "1z", "2x", "2y", "2z"};

void note(const std::string& text) { log::info("evaluation", "Note: " + text); }

void add_errors(ordered_json& json, const PairErrors& errors) {
  json["rms_error_percent_after_1s"] = errors.after_1s.rms_percent;
  json["rms_error_percent_first_1s"] = errors.first_1s.rms_percent;
  json["max_error_percent_after_1s"] = errors.after_1s.max_percent;
  json["p95_error_percent_after_1s"] = errors.after_1s.p95_percent;
  json["p95_error_percent_first_1s"] = errors.first_1s.p95_percent;
  json["max_error_percent_first_1s"] = errors.first_1s.max_percent;
  json["adaptation_s"] = errors.adaptation_s;
  json["largest_step_N"] = errors.largest_step_N;
  json["reference_rms_N"] = errors.reference_rms_N;
}

// nlohmann writes NaN, "nothing to measure", as null.
ordered_json json_of(const std::string& text, const PairVerdict& v, const PairForceMethod& method,
                     const GridGeometry& grid) {
  const auto cycles = [&](EstimateStatus status) {
    return v.cycles_by_status[static_cast<std::size_t>(status)];
  };
  ordered_json counters = ordered_json::object();
  for (const NamedCounter& counter : method.counters()) {
    counters[counter.name] = counter.value;
  }
  ordered_json json{{"method", text}, {"coupled", is_pair_method(method.name())}};
  add_errors(json, v.together);
  json.update({{"query_ns_median", v.query_ns_median},
               {"query_ns_p99", v.query_ns_p99},
               {"sample_us_median", v.sample_us_median},
               {"sample_us_p99", v.sample_us_p99},
               {"memory_bytes", v.memory_bytes},
               {"cycle_ns", v.cycle_ns},
               {"cycle_ns_median", v.cycle_ns_median},
               {"cycle_ns_p99", v.cycle_ns_p99},
               {"cycle_ns_p999", v.cycle_ns_p999},
               {"timer_floor_ns", v.timer_floor_ns},
               {"samples_taken", v.samples_taken},
               {"samples_not_taken", v.samples_not_taken},
               {"counters", counters},
               {"cycles_known", cycles(EstimateStatus::kOk)},
               {"cycles_partly_known", cycles(EstimateStatus::kPartlyKnown)},
               {"cycles_unknown", cycles(EstimateStatus::kUnknown)},
               {"cycles_outside_workspace", cycles(EstimateStatus::kOutside)},
               {"cycles_not_finite", cycles(EstimateStatus::kNotFinite)},
               {"workspace_m",
                {grid.min_W.x(), grid.min_W.y(), grid.min_W.z(), grid.max_W.x(), grid.max_W.y(),
                 grid.max_W.z()}}});
  json["tools"] = ordered_json::array();
  for (const PairErrors& errors : v.tools) {
    ordered_json tool;
    add_errors(tool, errors);
    json["tools"].push_back(tool);
  }
  return json;
}

void append(std::string& line, const PairVector& both) {
  for (const double value : both) {
    line += ',';
    evaluation::append_number(line, value);
  }
}

// t_s, positions, reference forces, then each method's forces. Commas in a method's text become
// blanks.
void write_forces(const std::string& file, const PairTrace& trace,
                  const std::vector<std::string>& names, const std::vector<PairVerdict>& verdicts) {
  std::string line = "t_s";
  const auto add_names = [&line](const std::string& before, const std::string& after) {
    for (const char* const component : kComponents) {
      line += ',';
      line += before;
      line += component;
      line += after;
    }
  };
  add_names("p", "_m");
  add_names("offline_", "_N");
  for (std::string name : names) {
    std::replace(name.begin(), name.end(), ',', ' ');
    add_names(name + "_", "_N");
  }
  evaluation::TextWriter writer(file);
  writer.write(line + "\n");
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    line.clear();
    evaluation::append_number(line, trace.servo[i].time_s);
    append(line, trace.servo[i].positions_W);
    append(line, trace.servo[i].forces_W);
    for (const PairVerdict& verdict : verdicts) {
      append(line, verdict.forces_W[i]);
    }
    writer.write(line + "\n");
  }
  writer.finish();
}

std::unique_ptr<PairForceMethod> made(const NamedVariant& named) {
  try {
    return make_pair_force_method(named.variant.name, named.variant.options);
  } catch (const std::invalid_argument& error) {
    throw UsageError("method '" + named.text + "': " + error.what());
  }
}

// The default box, or one around the trace if that does not hold it and no other was asked for.
void choose_workspace(const EvaluateOptions& options, const PairTrace& trace, GridGeometry& grid) {
  if (options.workspace_m.empty()) {
    grid = evaluation::workspace_of(trace, grid);
  } else if (const std::size_t outside = evaluation::positions_outside(grid, trace); outside > 0) {
    note(std::to_string(outside) + " of " + std::to_string(2 * trace.servo.size()) +
         " positions of the tools lie outside --workspace, where grid methods have no force");
  }
}

void note_what_is_missing(const EvaluateOptions& options, const PairTrace& trace) {
  if (trace.samples.empty()) {
    note(options.trace + " has no 'sample' row, so no method learns anything from it");
  }
  if (trace.servo.back().time_s - trace.servo.front().time_s < 1.0) {
    note(options.trace +
         " is not longer than one second, so the errors after the first second are unknown");
  }
}

}  // namespace

ordered_json evaluate_pair(const EvaluateOptions& options, MethodOptions base,
                           const VariantsOf& variants_of) {
  variants_of(base);  // refuses before the trace is read, which may take long
  ProgressLine line;
  line.begin("Reading " + options.trace);
  const PairTrace trace = evaluation::read_pair_trace(options.trace);
  line.clear();
  choose_workspace(options, trace, base.grid);
  const std::vector<NamedVariant> variants = variants_of(base);
  note_what_is_missing(options, trace);

  evaluation::PairJudgeOptions judging;
  judging.keep_forces = !options.out.empty();
  if (options.budget.us) {
    judging.work_budget = evaluation::kServoWorkBudget;  // what a budget is about
  }
  ordered_json all;
  std::vector<std::string> names;
  std::vector<PairVerdict> verdicts;
  for (const NamedVariant& named : variants) {
    line.show("Evaluating",
              static_cast<double>(names.size()) / static_cast<double>(variants.size()));
    const std::unique_ptr<PairForceMethod> method = made(named);
    verdicts.push_back(judge_pair(*method, trace, judging));
    names.push_back(named.text);
    all[named.text] = json_of(named.text, verdicts.back(), *method, base.grid);
  }
  line.clear();
  if (!options.out.empty()) {
    write_forces(options.out, trace, names, verdicts);
  }
  return variants.size() == 1 ? all.front() : all;
}

}  // namespace forcegrid::cli
