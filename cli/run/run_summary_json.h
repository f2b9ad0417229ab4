#pragma once

#include <nlohmann/json.hpp>

#include "cli/run/run_summary.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::cli {

/// The whole for programs; keys are documented in docs/summary_json.md.
nlohmann::json to_json(const RunSummary& summary, const servo::TelemetryStatistics& statistics);

}  // namespace forcegrid::cli
