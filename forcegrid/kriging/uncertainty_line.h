// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/tool_motion.h"

namespace forcegrid::kriging {

/// The uncertainty of a field's force near the tool, from the field's deviation at two points: the
/// tool's position P0 and where the tool will be a sample period later (at least 1 mm ahead).
///
///   u(P) = u0 + slope (P - P0).d + |slope| |(P - P0) - ((P - P0).d) d|
///
/// d is the direction of motion; a tool that moves less than 1 mm per sample may start in any
/// direction, so d is zero then. Exact at the two points; two deviations (O(rows^2)) per update,
/// none per lookup. Real-time: nothing allocates, locks or throws.
class UncertaintyLine {
 public:
  static constexpr double kLeastAhead_m = 1e-3;

  /// @param from_W P0.
  /// @param deviation_at_N callable, [N] the field's deviation at a position in the workspace
  /// frame.
  template <typename Deviation>
  void update(const Eigen::Vector3d& from_W, const ToolMotion& motion,
              const Deviation& deviation_at_N) noexcept {
    from_W_ = from_W;
    const double speed = motion.velocity_W().norm();
    const double moves_m = speed * motion.sample_period_s();
    const double ahead_m = std::max(moves_m, kLeastAhead_m);
    const Eigen::Vector3d direction =
        speed > 0.0 ? Eigen::Vector3d(motion.velocity_W() / speed) : Eigen::Vector3d::UnitX();
    const Eigen::Vector3d ahead_W = from_W_ + ahead_m * direction;
    from_N_ = deviation_at_N(from_W_);
    const double ahead_N = deviation_at_N(ahead_W);
    largest_N_ = std::max(from_N_, ahead_N);
    slope_N_per_m_ = (ahead_N - from_N_) / ahead_m;
    direction_ = moves_m < kLeastAhead_m ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : direction;
  }

  /// [N] At least `least_N`.
  double at_N(const Eigen::Vector3d& position_W, double least_N) const noexcept {
    const Eigen::Vector3d d = position_W - from_W_;
    const double along_m = d.dot(direction_);
    const double beside_m = std::sqrt(std::max(0.0, d.squaredNorm() - along_m * along_m));
    return std::max(least_N,
                    from_N_ + slope_N_per_m_ * along_m + std::abs(slope_N_per_m_) * beside_m);
  }

  /// [N] The larger one of the two.
  double largest_N() const noexcept { return largest_N_; }

 private:
  Eigen::Vector3d from_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction_ = Eigen::Vector3d::Zero();
  double from_N_ = 0.0;
  double largest_N_ = 0.0;
  double slope_N_per_m_ = 0.0;
};

}  // namespace forcegrid::kriging
