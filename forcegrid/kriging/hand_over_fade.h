// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace forcegrid::kriging {

/// Keeps the force continuous where one field takes over from another: their difference at that
/// moment is added to the new field's force and fades out.
///
///   F(t) = F_new(t) + (F_old(t0) - F_new(t0)) exp(-(t - t0) / tau)
///
/// If a difference has not faded out when the next begins, it is carried on. Five tau after the
/// last one nothing is added. Real-time: nothing allocates, locks or throws.
class HandOverFade {
 public:
  /// @param tau_s [s] time constant, positive.
  explicit HandOverFade(double tau_s) noexcept : tau_s_(tau_s) {}

  void start(double time_s, const Eigen::Vector3d& old_N, const Eigen::Vector3d& new_N) noexcept {
    const double left = std::exp(-(time_s - begun_s_) / tau_s_);
    difference_N_ = left * difference_N_ + old_N - new_N;
    begun_s_ = time_s;
  }
  void clear() noexcept { difference_N_.setZero(); }

  /// [N] The force to add to the new field's.
  Eigen::Vector3d at(double time_s) const noexcept {
    const double age_s = time_s - begun_s_;
    if (!(age_s < 5.0 * tau_s_)) {
      return Eigen::Vector3d::Zero();
    }
    return difference_N_ * std::exp(-std::max(age_s, 0.0) / tau_s_);
  }

 private:
  double tau_s_;
  Eigen::Vector3d difference_N_ = Eigen::Vector3d::Zero();
  double begun_s_ = 0.0;
};

}  // namespace forcegrid::kriging
