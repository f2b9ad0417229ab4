// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "cli/run/run_summary.h"
#include "servo_loop/telemetry.h"

namespace forcegrid::cli {

/// Returns the whole summary for programs; docs/summary_json.md documents the keys.
nlohmann::json to_json(const RunSummary& summary, const servo::TelemetryStatistics& statistics);

}  // namespace forcegrid::cli
