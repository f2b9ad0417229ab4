// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace forcegrid::kriging {

/// The distance between two samples, and whether both are worth keeping.
///
///   distance = max(|dP|, metres / newtons |dF|)
///
/// A light hand moves less than a millimetre on a stiff object: only the force distinguishes its
/// samples.
/// Source: docs/kriging.md, "The field".
/// Real-time: yes. Threads: const.
struct SampleSpacing {
  double metres = 1e-3;
  double newtons = 0.1;

  /// [m^2] of samples whose positions are moved_m2 = |dP|^2 apart, their forces changed_N2.
  double distance_m2(double moved_m2, double changed_N2) const noexcept {
    const double metres_per_newton = metres / newtons;
    return std::max(moved_m2, metres_per_newton * metres_per_newton * changed_N2);
  }
  /// Closer samples, of a dictionary of few. Forces are told apart by half of `newtons` at least:
  /// noise that the field does not expect must not fill it. @param share above 0 and at most 1.
  SampleSpacing of_few(double share) const noexcept {
    return {metres * share, newtons * std::max(0.5, share)};
  }
  /// Far enough from every other to be kept beside them.
  bool apart(double distance_m2) const noexcept { return distance_m2 >= metres * metres; }
  /// So close that it repeats the same measurement and may replace the first.
  bool repeated(double distance_m2) const noexcept {
    constexpr double kFraction = 0.3;
    return distance_m2 < kFraction * kFraction * metres * metres;
  }
};

}  // namespace forcegrid::kriging
