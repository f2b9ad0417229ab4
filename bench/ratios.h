// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::bench {

/// Requests a line "numerator / denominator" in the table of ratios at the end of the run. Both are
/// benchmark names; the value is the ratio of their median times per item.
/// @param goal text printed beside the value, e.g. "<= 0.2".
void report_ratio(const std::string& numerator, const std::string& denominator,
                  const std::string& goal);

/// Requests a line with the benchmark's median time per item in nanoseconds, and that time scaled
/// to a core on which the bare trilinear read takes 4 ns.
void report_time(const std::string& name, const std::string& goal);

}  // namespace forcegrid::bench
