// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace forcegrid::evaluation {

/// Share of a smooth movement that is done after `fraction` [0, 1] of its time; beyond, its ends.
/// Source: Flash and Hogan, J. Neuroscience 5(7), 1985.
inline double minimum_jerk(double fraction) {
  const double t = std::clamp(fraction, 0.0, 1.0);
  return t * t * t * (10.0 + t * (-15.0 + 6.0 * t));
}

}  // namespace forcegrid::evaluation
