// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/simple/affine_methods.h"

namespace forcegrid {

bool AffineMethod::learn(const Sample& sample, bool first) noexcept {
  Eigen::Vector3d step_W_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d change_W_N = Eigen::Vector3d::Zero();
  if (!first) {
    step_W_m = sample.position_W - position_W_;
    change_W_N = sample.force_W - force_W_;
  }
  if (!learn_slope(sample, step_W_m, change_W_N, slope_W_)) {
    return false;
  }
  position_W_ = sample.position_W;
  force_W_ = sample.force_W;
  return true;
}

void AffineMethod::forget() noexcept {
  position_W_.setZero();
  force_W_.setZero();
  slope_W_.setZero();
}

// A position that is not finite makes the force not finite, even with a zero slope.
ForceEstimate AffineMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  return estimate(time_s, force_W_ + slope_W_ * (position_W - position_W_));
}

bool SecantMethod::learn_slope(const Sample& /*sample*/, const Eigen::Vector3d& step_W_m,
                               const Eigen::Vector3d& change_W_N,
                               Eigen::Matrix3d& slope_W) const noexcept {
  const double squared_m2 = step_W_m.squaredNorm();
  if (squared_m2 > kShortestStep_m * kShortestStep_m) {
    slope_W = change_W_N * step_W_m.transpose() / squared_m2;
  }
  return true;
}

bool BroydenMethod::learn_slope(const Sample& /*sample*/, const Eigen::Vector3d& step_W_m,
                                const Eigen::Vector3d& change_W_N,
                                Eigen::Matrix3d& slope_W) const noexcept {
  const double squared_m2 = step_W_m.squaredNorm();
  if (squared_m2 > kShortestStep_m * kShortestStep_m) {
    const Eigen::Vector3d unexplained_W_N = change_W_N - slope_W * step_W_m;
    slope_W += unexplained_W_N * step_W_m.transpose() / squared_m2;
  }
  return true;
}

bool TangentMethod::learn_slope(const Sample& sample, const Eigen::Vector3d& /*step_W_m*/,
                                const Eigen::Vector3d& /*change_W_N*/,
                                Eigen::Matrix3d& slope_W) const noexcept {
  if (!sample.has_stiffness || !sample.stiffness_W.allFinite()) {
    return false;
  }
  slope_W = sample.stiffness_W;
  return true;
}

}  // namespace forcegrid
