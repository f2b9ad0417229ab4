// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "stability/closed_loop.h"

namespace forcegrid::stability {

/// The largest stiffness up to which a loop is stable, and its behaviour above.
struct StiffnessLimit {
  double largest_stable_N_per_m = 0.0;  ///< 0: not even kLeast_N_per_m
  /// No stiffness of the scan was unstable: the limit is kMost_N_per_m or above.
  bool beyond_scan = false;
  double smallest_unstable_N_per_m = 0.0;  ///< NaN when beyond_scan
  Behaviour failure = Behaviour::kStable;  ///< there
};

/// The scan tries octaves of stiffness from its first one upwards until one is unstable. It then
/// bisects that octave to a factor of 2^(1/32), 2.2 %.
struct StiffnessScan {
  static constexpr double kLeast_N_per_m = 2.5;
  static constexpr double kMost_N_per_m = 10240.0;
  static constexpr int kBisections = 5;
};

/// Runs the scan. @param behaviour runs the loop once with a stiffness [N/m].
/// @param first_N_per_m an octave of the scan where runs take long: those below are tried only if
/// it is unstable.
StiffnessLimit find_limit(const std::function<Behaviour(double stiffness_N_per_m)>& behaviour,
                          double first_N_per_m = StiffnessScan::kLeast_N_per_m);

}  // namespace forcegrid::stability
