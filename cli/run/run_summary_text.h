// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "cli/run/run_summary.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::cli {

/// Returns the fault or emergency stop that ended the loop, and what to do, on one line.
std::string fault_text(const servo::ServoOutcome& outcome);

/// Returns the text that is printed as soon as the loop has ended: everything but the errors.
std::string loop_text(const RunSummary& summary, const servo::TelemetryStatistics& statistics);

/// Returns what the emulated motors did, from the emulator's report.
std::string motors_text(const nlohmann::json& emulator);

/// Returns how many of the simulator's queries each worker answered, from the simulator's report;
/// empty without workers.
std::string workers_text(const nlohmann::json& simulator);

/// Returns the errors against the reference force and the files written.
std::string errors_text(const RunSummary& summary);

}  // namespace forcegrid::cli
