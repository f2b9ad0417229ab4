// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::servo {

struct DampingFieldOptions {
  double damping_N_s_per_m = 3.0;
  double max_force_N = 1.0;
  double dead_band_counts = 1.0;  ///< see without_trembling_counts()
  /// Time constant of the filter that the velocity comes from.
  double velocity_time_constant_s = 0.010;
};

/// Replaces a force that has faded: the hand feels thick air instead of an object that lets go.
/// F = -min(b |u|, F_max) u / |u|, with u the low-passed velocity behind a dead band.
///
/// The field cannot oscillate. With the filter and a sampled loop of delay d, a mass m has a phase
/// margin of 90 deg - atan(w tau) - w d at w = b / m, for small w tau: 50 deg for the lightest arm
/// alone (46 g, d = 3 ms), more with a hand. The dead band hides a trembling count.
/// Real-time: no allocation, lock or throw. Threads: any; it has no state.
class DampingField {
 public:
  /// @throws std::invalid_argument naming the option that can't be used.
  explicit DampingField(const DampingFieldOptions& options = {});

  /// @param velocity_W [m/s] low-passed. @param resolution_W_m [m] of one count by axis.
  /// @returns the force on the hand [N]; zero for a velocity that is not finite.
  [[nodiscard]] Eigen::Vector3d force_W(const Eigen::Vector3d& velocity_W,
                                        const Eigen::Vector3d& resolution_W_m) const noexcept;

 private:
  DampingFieldOptions options_;
};

}  // namespace forcegrid::servo
