// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>

#include "evaluation/scenarios/touched_object.h"
#include "evaluation/traces/trace.h"

namespace forcegrid::evaluation {

/// RMS errors that no method can be below, in % of the RMS of |F_o| over the trace, as in Verdict.
struct BlindLimit {
  double first_1s_percent = std::numeric_limits<double>::quiet_NaN();
  double after_1s_percent = std::numeric_limits<double>::quiet_NaN();
};

/// The error of a method that is as good as samples along the path allow. It renders no force until
/// the first sample of the trace arrives. From then on it knows the object's law exactly, viscosity
/// and relaxation included. What it can't know is what has changed since: a wall not touched yet, a
/// cut, another place's stiffness, a slide. It renders the law that it knows until a sample arrives
/// whose true force differs from that law's by more than 0.1 N or by more than 1 % of itself and 1
/// mN, which is a converged simulator's own error; then it knows the walls that push there and how
/// stiff the object is. In a slide it takes the object to be where the newest sample saw it. A
/// method that makes requests, is given stiffness or touches that the loop sees, or extrapolates a
/// slide may be better.
/// @throws ChartError for a trajectory that leaves the object's table.
BlindLimit blind_limit(const TouchedObject& object, const Trace& trace);

}  // namespace forcegrid::evaluation
