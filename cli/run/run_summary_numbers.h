// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "cli/run/run_summary.h"

namespace forcegrid::cli {

/// Returns one of the rendered method's counters by its name; 0 if the method has no such counter.
std::uint64_t counter(const RunSummary& summary, const std::string& name);

/// [ms] Time that an answered first touch waited for the simulator, on average; 0 without any.
double mean_wait_ms(const servo::FirstTouch::Counts& touches);

/// [Hz] Cycles per second between the first and the last cycle; 0 for fewer than two.
double measured_rate_Hz(const RunSummary& summary);

}  // namespace forcegrid::cli
