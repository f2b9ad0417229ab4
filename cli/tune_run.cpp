// SPDX-License-Identifier: Apache-2.0
#include "cli/tune_run.h"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "cli/common/child_process.h"
#include "cli/common/stop_request.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::TuningRow;

constexpr std::chrono::seconds kPatience{120};
constexpr std::chrono::milliseconds kPoll{50};
// Its own story is the same in each; warnings, and what its simulator says, are passed on.
const ChildOptions kRunOfTune{
    .name = "run", .drives_motors = true, .announces_start = false, .says_details = true};

std::vector<std::string> run_arguments(const TuneRuns& runs, const std::string& method,
                                       double rate_Hz, int fill_budget, double seconds) {
  std::vector<std::string> arguments{"run",
                                     "--device",
                                     runs.device,
                                     "--scene",
                                     runs.scene,
                                     "--motion",
                                     runs.motion,
                                     "--hand",
                                     runs.hand,
                                     "--method",
                                     method,
                                     "--evaluate",
                                     method,
                                     "--rate",
                                     std::to_string(rate_Hz),
                                     "--fill-budget",
                                     std::to_string(fill_budget),
                                     "--seconds",
                                     std::to_string(seconds),
                                     "--out",
                                     runs.folder};
  if (runs.calibrated) {
    arguments.emplace_back("--calibrated");
  }
  if (!runs.profile.empty()) {
    arguments.insert(arguments.end(), {"--profile", runs.profile});
  }
  return arguments;
}

// Why the run did not end by itself; empty if it did.
std::string wait_for(ChildProcess& run, double seconds) {
  const auto deadline = std::chrono::steady_clock::now() +
                        std::chrono::milliseconds(std::lround(1e3 * seconds)) + kPatience;
  while (run.running() && !StopRequest::stop() && std::chrono::steady_clock::now() < deadline) {
    static_cast<void>(run.read_line(kPoll));  // so that its pipe does not fill up
  }
  if (!run.running()) {
    return "";
  }
  return StopRequest::stop() ? "stopped" : "the run did not end";
}

double percentile(const ordered_json& summary, const char* key, const char* which) {
  return summary.at(key).at(which).get<double>();
}

void take(const ordered_json& summary, TuningRow& row) {
  if (!summary.at("faults").empty()) {
    row.problem = summary.at("faults").front().at("sentence").get<std::string>();
    return;
  }
  const ordered_json& errors = summary.at("errors");
  if (errors.empty()) {
    row.problem = "the error is unknown: " + summary.at("reference").get<std::string>();
    return;
  }
  row.error_percent = errors.front().at("rms_error_percent_after_1s").get<double>();
  const double missed = summary.at("missed_deadlines").get<double>();
  row.missed_percent = 100.0 * missed / (missed + summary.at("cycles").get<double>());
  row.period_p99_us = percentile(summary, "period_us", "p99");
  row.compute_p50_us = percentile(summary, "compute_us", "p50");
  row.compute_p99_us = percentile(summary, "compute_us", "p99");
  const double samples = summary.at("samples_taken").get<double>();
  const double cut = summary.at("counters").value("fills_cut_short", 0.0);
  row.backlog_percent = samples > 0.0 ? 100.0 * cut / samples : 0.0;
  row.measured = true;
}

}  // namespace

evaluation::Trace record_path(const TuneRuns& runs, double rate_Hz, double seconds) {
  const std::string file = runs.folder + "/path.csv.gz";
  std::filesystem::create_directories(runs.folder);
  std::filesystem::remove(file);
  std::vector<std::string> arguments =
      run_arguments(runs, kDefaultMethod, rate_Hz, RunOptions().fill_budget, seconds);
  arguments.insert(arguments.end(), {"--record", file});
  ChildProcess run(arguments, kRunOfTune);
  const std::string problem = wait_for(run, seconds);
  if (!problem.empty() || !std::filesystem::exists(file)) {
    throw std::runtime_error(
        "no path was recorded: " +
        (problem.empty() ? "the run ended early (its message is above)" : problem));
  }
  return evaluation::read_trace(file);
}

void measure_in_loop(const TuneRuns& runs, double seconds, TuningRow& row) {
  const std::string file = runs.folder + "/summary.json";
  std::filesystem::create_directories(runs.folder);
  std::filesystem::remove(file);
  std::vector<std::string> arguments =
      run_arguments(runs, row.method, row.rate_Hz, row.fill_budget, seconds);
  arguments.insert(arguments.end(), {"--json", file});
  ChildProcess run(arguments, kRunOfTune);
  row.problem = wait_for(run, seconds);
  if (!row.problem.empty()) {
    return;
  }
  std::ifstream stream(file);
  const ordered_json summary = ordered_json::parse(stream, nullptr, false);
  if (summary.is_discarded()) {
    row.problem = "the run gave no summary (its message is above)";
    return;
  }
  try {
    take(summary, row);
  } catch (const ordered_json::exception&) {
    row.problem = "the run ended before its loop began (its message is above)";
  }
}

}  // namespace forcegrid::cli
