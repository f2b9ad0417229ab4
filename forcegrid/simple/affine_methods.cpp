#include "forcegrid/simple/affine_methods.h"

#include <cmath>

namespace forcegrid {

void AffineMethod::take_sample(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !sample.position_W.allFinite() ||
      !std::isfinite(sample.time_s) || sample.from_query ||
      (has_sample_ && sample.time_s < newest_time_s_)) {
    return;
  }
  Eigen::Vector3d step_W_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d change_W_N = Eigen::Vector3d::Zero();
  if (has_sample_) {
    step_W_m = sample.position_W - position_W_;
    change_W_N = sample.force_W - force_W_;
  }
  if (!learn_slope(sample, step_W_m, change_W_N, slope_W_)) {
    return;
  }
  newest_time_s_ = sample.time_s;
  position_W_ = sample.position_W;
  force_W_ = sample.force_W;
  has_sample_ = true;
  status_ = EstimateStatus::kOk;
}

void AffineMethod::contact_made(std::uint32_t /*epoch*/,
                                const Eigen::Vector3d& /*point_W*/) noexcept {
  forget();
  status_ = EstimateStatus::kUnknown;
}

void AffineMethod::contact_lost() noexcept {
  forget();
  status_ = EstimateStatus::kOk;  // free space: the force is known to be zero
}

void AffineMethod::forget() noexcept {
  has_sample_ = false;
  position_W_.setZero();
  force_W_.setZero();
  slope_W_.setZero();
}

int AffineMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate AffineMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  estimate.status = status_;
  estimate.force_W = force_W_ + slope_W_ * (position_W - position_W_);
  // A position that is not finite makes the force so, zero slope or not.
  if (!std::isfinite(time_s) || !estimate.force_W.allFinite()) {
    estimate.force_W.setZero();
    estimate.status = EstimateStatus::kNotFinite;
  }
  return estimate;
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
