// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_summary_numbers.h"

namespace forcegrid::cli {

std::uint64_t counter(const RunSummary& summary, const std::string& name) {
  const auto found = summary.counters.find(name);
  return found == summary.counters.end() ? 0 : found->second;
}

double mean_wait_ms(const servo::FirstTouch::Counts& touches) {
  return touches.answered == 0 ? 0.0
                               : 1e3 * touches.wait_sum_s / static_cast<double>(touches.answered);
}

double measured_rate_Hz(const RunSummary& summary) {
  return summary.elapsed_s > 0.0 && summary.outcome.cycles > 1
             ? static_cast<double>(summary.outcome.cycles - 1) / summary.elapsed_s
             : 0.0;
}

}  // namespace forcegrid::cli
