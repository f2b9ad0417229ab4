#include "forcegrid/simple/rls_method.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace forcegrid {
namespace {

constexpr double kLength_m = 0.02;
constexpr double kForgetting = 0.97;  // a sample
constexpr double kRidgeConstant = 1e-9;
constexpr double kRidgeLinear = 1e-4;
constexpr double kRidgeQuadratic = 1e-3;

}  // namespace

RlsMethod::Features RlsMethod::features_at(const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Vector3d u = (position_W - centre_W_) / kLength_m;
  Features features;
  features << 1.0, u.x(), u.y(), u.z(), u.x() * u.x(), u.y() * u.y(), u.z() * u.z(), u.x() * u.y(),
      u.x() * u.z(), u.y() * u.z();
  return features;
}

void RlsMethod::take_sample(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !sample.position_W.allFinite() ||
      !std::isfinite(sample.time_s) || sample.from_query ||
      (has_sample_ && sample.time_s < newest_time_s_)) {
    return;
  }
  if (!has_sample_) {
    centre_W_ = sample.position_W;
  }
  const Features features = features_at(sample.position_W);
  gram_ = kForgetting * gram_ + features * features.transpose();
  moment_W_N_ = kForgetting * moment_W_N_ + features * sample.force_W.transpose();

  Eigen::Matrix<double, kFeatures, kFeatures> regularised = gram_;
  regularised.diagonal()[0] += kRidgeConstant;
  regularised.diagonal().segment<3>(1).array() += kRidgeLinear;
  regularised.diagonal().segment<6>(4).array() += kRidgeQuadratic;
  const Eigen::LLT<Eigen::Matrix<double, kFeatures, kFeatures>> cholesky(regularised);
  if (cholesky.info() == Eigen::Success) {
    const Eigen::Matrix<double, kFeatures, 3> theta_W_N = cholesky.solve(moment_W_N_);
    anchored_W_N_ = theta_W_N.transpose();
  } else {
    anchored_W_N_.setZero();  // beyond what doubles resolve; the anchor alone makes it hold
  }
  const Eigen::Vector3d residual_W_N = sample.force_W - anchored_W_N_ * features;
  anchored_W_N_.col(0) += residual_W_N;

  newest_time_s_ = sample.time_s;
  has_sample_ = true;
  status_ = EstimateStatus::kOk;
}

void RlsMethod::contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& /*point_W*/) noexcept {
  forget();
  status_ = EstimateStatus::kUnknown;
}

void RlsMethod::contact_lost() noexcept {
  forget();
  status_ = EstimateStatus::kOk;  // free space: the force is known to be zero
}

void RlsMethod::forget() noexcept {
  has_sample_ = false;
  gram_.setZero();
  moment_W_N_.setZero();
  anchored_W_N_.setZero();
}

int RlsMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate RlsMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  estimate.status = status_;
  estimate.force_W = anchored_W_N_ * features_at(position_W);
  // A position that is not finite makes the force so, null coefficients or not.
  if (!std::isfinite(time_s) || !estimate.force_W.allFinite()) {
    estimate.force_W.setZero();
    estimate.status = EstimateStatus::kNotFinite;
  }
  return estimate;
}

}  // namespace forcegrid
