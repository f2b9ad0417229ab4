// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/simple/rls_method.h"

#include <Eigen/Cholesky>

namespace forcegrid {
namespace {

constexpr double kLength_m = 0.02;
constexpr double kForgetting = 0.97;  // per sample
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

bool RlsMethod::learn(const Sample& sample, bool first) noexcept {
  if (first) {
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
    anchored_W_N_.setZero();  // below the resolution of doubles; the anchor alone holds the force
  }
  const Eigen::Vector3d residual_W_N = sample.force_W - anchored_W_N_ * features;
  anchored_W_N_.col(0) += residual_W_N;
  return true;
}

void RlsMethod::forget() noexcept {
  gram_.setZero();
  moment_W_N_.setZero();
  anchored_W_N_.setZero();
}

// A position that is not finite makes the force not finite, even with zero coefficients.
ForceEstimate RlsMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  return estimate(time_s, anchored_W_N_ * features_at(position_W));
}

}  // namespace forcegrid
