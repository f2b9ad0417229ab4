// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_collect.h"

#include <limits>
#include <stdexcept>

namespace forcegrid::cli {

void collect_counts(const RunCounters& counters, const std::string& method, double requests_per_s,
                    RunSummary& summary) {
  const auto note = [&](const std::string& text) { summary.notes.push_back(text); };
  for (const std::string& refused :
       {summary.outcome.memory_lock_refused, summary.outcome.awake_refused}) {
    if (!refused.empty()) {
      note(refused);
    }
  }
  summary.link = counters.link.statistics();
  summary.samples_received = counters.link.samples_accepted();
  summary.simulator_clock = counters.link.simulator_clock();
  summary.samples_not_converged = counters.link.samples_not_converged();
  summary.worst_relative_residual = counters.link.worst_relative_residual();
  summary.worst_solve_time_s = counters.link.worst_solve_time_s();
  summary.samples_overrun = counters.link.samples_lost();
  summary.records_lost = counters.ports.records_lost.load();
  const auto& records = counters.telemetry.records();
  if (records.size() > 1) {
    summary.elapsed_s =
        1e-9 * static_cast<double>(records.back().time_ns - counters.telemetry.first_time_ns());
  }
  if (requests_per_s > 0.0 && summary.outcome.requests_made == 0) {
    note("method " + method + " made no request");
  }
  for (const std::string& text : counters.watch.notes()) {
    note(text);
  }
  if (!counters.link.simulator_knows_poses()) {
    note(
        "the simulator speaks an older version of the link: it does not get the tool's "
        "orientation, and its answers have no torque");
  }
  summary.cycles_kept = records.size();
  if (summary.cycles_kept < counters.telemetry.statistics().cycles) {
    note("only the last " + std::to_string(summary.cycles_kept) +
         " cycles were kept; errors, CSV and picture are theirs");
  }
  const ForceMethod& rendered = counters.methods.rendered();
  for (const NamedCounter& counter : rendered.counters()) {
    summary.counters[counter.name] = counter.value;
  }
  for (const char* candidate : rendered.candidates()) {
    summary.candidates.emplace_back(candidate);
  }
}

void write_flight_records(const servo::Telemetry& telemetry, const std::string& out,
                          RunSummary& summary) {
  const auto write = [&](const std::string& name, std::int64_t end_ns) {
    const std::string file = out + "/" + name;
    try {
      telemetry.write_flight_record(file, servo::Telemetry::kFlightRecord_s, end_ns);
      summary.files.push_back(file);
    } catch (const std::runtime_error& error) {
      summary.notes.emplace_back(error.what());
    }
  };
  for (std::size_t i = 0; i < summary.recovered.size(); ++i) {
    write("flight_record_" + std::to_string(i + 1) + ".csv", summary.recovered[i].time_ns);
  }
  if (summary.outcome.fault != servo::Fault::kNone) {
    write("flight_record.csv", std::numeric_limits<std::int64_t>::max());
  }
}

}  // namespace forcegrid::cli
