// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <vector>

namespace forcegrid::evaluation {

/// The smallest value that a fraction `p` of `values` does not exceed; NaN without values. Reorders
/// them.
double percentile(std::vector<double>& values, double p);

/// RMS, 95th percentile and maximum of some instants' error, in % of the reference's RMS. NaN
/// without instants or reference.
struct ErrorFigures {
  double rms_percent = std::numeric_limits<double>::quiet_NaN();
  double p95_percent = std::numeric_limits<double>::quiet_NaN();
  double max_percent = std::numeric_limits<double>::quiet_NaN();
};

/// @param error_N [N] magnitude of the error at each instant.
ErrorFigures error_figures(std::vector<double> error_N, double reference_rms_N);

/// [s] End of the first half second from which on the RMS error of every half second is below 5 %;
/// NaN: never.
/// @param since_start_s  [s] of each instant since the first, rising. @param error_N as above.
double adaptation_s(const std::vector<double>& since_start_s, const std::vector<double>& error_N,
                    double reference_rms_N);

}  // namespace forcegrid::evaluation
