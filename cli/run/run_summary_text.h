#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "cli/run/run_summary.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::cli {

/// The text for people that is printed as soon as the loop has ended: everything but the errors.
std::string loop_text(const RunSummary& summary, const servo::TelemetryStatistics& statistics);

/// What the emulated motors did, from the emulator's report.
std::string motors_text(const nlohmann::json& emulator);

/// Who answered the simulator's queries, from its report; empty without workers.
std::string workers_text(const nlohmann::json& simulator);

/// The errors and the files, once they are there.
std::string errors_text(const RunSummary& summary);

}  // namespace forcegrid::cli
