// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/run/run_methods.h"
#include "cli/run/run_summary.h"
#include "cli/run/simulator_watch.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_ports.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::cli {

/// What counted during a run; its threads have ended.
struct RunCounters {
  const servo::LinkThread& link;
  const servo::ServoPorts& ports;
  const servo::Telemetry& telemetry;
  const RunMethods& methods;
  const SimulatorWatch& watch;
};

/// Copies the counters of link, telemetry and method into the summary, and notes what is unusual.
/// @param method  as the person named it. @param requests_per_s  that it was to make.
void collect_counts(const RunCounters& counters, const std::string& method, double requests_per_s,
                    RunSummary& summary);

/// Writes the last seconds before each fault into the folder `out`; a failure is a note.
void write_flight_records(const servo::Telemetry& telemetry, const std::string& out,
                          RunSummary& summary);

}  // namespace forcegrid::cli
