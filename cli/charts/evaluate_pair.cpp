// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/evaluate_pair.h"

#include <array>
#include <nlohmann/json.hpp>
#include <string_view>

#include "cli/charts/evaluate_output.h"
#include "cli/common/progress_line.h"
#include "evaluation/judge/judge.h"
#include "evaluation/judge/pair_judge.h"
#include "evaluation/traces/pair_trace.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/pair_methods.h"

namespace forcegrid::cli {
namespace {

using evaluation::ForceErrors;
using evaluation::PairTrace;
using evaluation::PairVerdict;
using nlohmann::ordered_json;

constexpr std::array<std::string_view, 6> kPairComponents = {"1x", "1y", "1z", "2x", "2y", "2z"};

void add_errors(ordered_json& json, const ForceErrors& errors) {
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
  ordered_json json{{"method", text}, {"coupled", is_pair_method(method.name())}};
  add_errors(json, v.together);
  json.update({{"query_ns_median", v.query_ns_median},
               {"query_ns_p99", v.query_ns_p99},
               {"sample_us_median", v.sample_us_median},
               {"sample_us_p99", v.sample_us_p99},
               {"memory_bytes", v.memory_bytes}});
  add_cycle_costs(json, v);
  json["samples_taken"] = v.samples_taken;
  json["samples_not_taken"] = v.samples_not_taken;
  add_counters(json, method.counters(), v.cycles_by_status);
  json["workspace_m"] = json_of_workspace(grid);
  json["tools"] = ordered_json::array();
  for (const ForceErrors& errors : v.tools) {
    ordered_json tool;
    add_errors(tool, errors);
    json["tools"].push_back(tool);
  }
  return json;
}

void write_forces(const std::string& file, const PairTrace& trace,
                  const std::vector<std::string>& names, const std::vector<PairVerdict>& verdicts) {
  write_force_columns(file, {"p", kPairComponents}, names, trace.servo.size(),
                      [&](std::size_t i, std::vector<double>& numbers) {
                        const auto add = [&](const PairVector& both) {
                          numbers.insert(numbers.end(), both.begin(), both.end());
                        };
                        numbers.push_back(trace.servo[i].time_s);
                        add(trace.servo[i].positions_W);
                        add(trace.servo[i].forces_W);
                        for (const PairVerdict& verdict : verdicts) {
                          add(verdict.forces_W[i]);
                        }
                      });
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
    note_of_evaluation(
        std::to_string(outside) + " of " + std::to_string(2 * trace.servo.size()) +
        " positions of the tools lie outside --workspace, where grid methods have no force");
  }
}

void note_what_is_missing(const EvaluateOptions& options, const PairTrace& trace) {
  if (trace.samples.empty()) {
    note_of_evaluation(options.trace +
                       " has no 'sample' row, so no method learns anything from it");
  }
  if (trace.servo.back().time_s - trace.servo.front().time_s < 1.0) {
    note_of_evaluation(
        options.trace +
        " is not longer than one second, so the errors after the first second are unknown");
  }
}

}  // namespace

std::vector<std::string> texts_of(const std::vector<NamedVariant>& variants) {
  std::vector<std::string> texts;
  texts.reserve(variants.size());
  for (const NamedVariant& named : variants) {
    texts.push_back(named.text);
  }
  return texts;
}

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
  judging.stiffness_to_method = !options.no_stiffness;
  judging.keep_forces = !options.out.empty();
  if (options.budget.us) {
    judging.work_budget = evaluation::kServoWorkBudget;  // what a budget is about
  }
  const std::vector<std::string> names = texts_of(variants);
  std::vector<PairVerdict> verdicts;
  const ordered_json result = evaluate_each(names, [&](std::size_t i) {
    const std::unique_ptr<PairForceMethod> method = made(variants[i]);
    verdicts.push_back(judge_pair(*method, trace, judging));
    return json_of(names[i], verdicts.back(), *method, base.grid);
  });
  if (!options.out.empty()) {
    write_forces(options.out, trace, names, verdicts);
  }
  return result;
}

}  // namespace forcegrid::cli
