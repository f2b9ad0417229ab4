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

/// What one servo instant says about a method's error. The magnitudes are of one tool's force, or
/// of several tools' forces as one vector.
struct ErrorInstant {
  double time_s = 0.0;
  double reference_N2 = 0.0;  ///< square of the reference's magnitude
  double error_N = 0.0;
  double step_N = 0.0;  ///< by which the error differs from that of the instant before
};

/// Errors of forces on a trace. Percentages refer to the RMS of the reference's magnitude over the
/// whole trace; "after" starts one second after the first servo instant.
struct ForceErrors {
  double reference_rms_N = 0.0;
  ErrorFigures first_1s;
  ErrorFigures after_1s;
  double adaptation_s = 0.0;    ///< see adaptation_s()
  double largest_step_N = 0.0;  ///< of the error between two cycles, after 1 s; NaN: none
};

/// @param instants  times strictly rising; not empty.
ForceErrors force_errors(const std::vector<ErrorInstant>& instants);

}  // namespace forcegrid::evaluation
