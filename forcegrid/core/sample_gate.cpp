// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/core/sample_gate.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {
namespace {

constexpr int kLearning = 3;          // samples until the observed stiffness is trusted
constexpr double kShortest_m = 1e-4;  // shortest step that shows a stiffness
constexpr double kKept = 0.97;        // of the largest observed stiffness, per sample

}  // namespace

std::span<const Sample> SampleGate::pass(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !sample.position_W.allFinite()) {
    passed_[1] = sample;
    return {&passed_[1], 1};
  }
  wary_ = std::max(wary_ - 1, 0);
  if (follows(sample) || (wary_ == 0 && !holds_ && resists(sample))) {
    refuse_held();
    believe(sample);
    passed_[1] = sample;
    return {&passed_[1], 1};
  }
  if (bears_out(sample)) {
    holds_ = false;
    slope_N_per_m_.setZero();
    position_m_ = passed_[0].position_W;
    force_N_ = passed_[0].force_W;
    believe(sample);
    passed_[1] = sample;
    return {passed_.data(), 2};
  }
  refuse_held();
  passed_[0] = sample;
  holds_ = true;
  return {};
}

void SampleGate::forget() noexcept {
  refused_ += holds_ ? 1 : 0;  // this is no fault of the simulator
  holds_ = false;
  believed_ = 0;
  slope_N_per_m_.setZero();
  steepest_N_per_m_ = 0.0;
}

bool SampleGate::follows(const Sample& sample) const noexcept {
  if (believed_ == 0) {
    return true;
  }
  const Eigen::Vector3d step_m = sample.position_W - position_m_;
  const Eigen::Vector3d expected = expected_N(step_m);
  const double size_N2 = expected.squaredNorm();
  const double share =
      size_N2 > 0.0 ? std::clamp(sample.force_W.dot(expected) / size_N2, 0.0, 1.0) : 0.0;
  return (sample.force_W - share * expected).norm() <= allowed_N(step_m);
}

bool SampleGate::resists(const Sample& sample) const noexcept {
  const Eigen::Vector3d step_m = sample.position_W - position_m_;
  const Eigen::Vector3d surprise_N = sample.force_W - expected_N(step_m);
  const double size_N = surprise_N.norm();
  return size_N * (size_N - kSlack_N) <= -kMostStiffness_N_per_m * surprise_N.dot(step_m);
}

bool SampleGate::bears_out(const Sample& sample) const noexcept {
  if (!holds_) {
    return false;
  }
  const Sample& held = passed_[0];
  const double apart_N = (sample.force_W - held.force_W).norm();
  const double step_m = (sample.position_W - held.position_W).norm();
  const double surprise_N = (held.force_W - expected_N(held.position_W - position_m_)).norm();
  return apart_N <= std::min(surprise_N, kSlack_N + kMostStiffness_N_per_m * step_m) &&
         (std::max(sample.force_W.norm(), held.force_W.norm()) <= max_force_N_ || resists(sample));
}

double SampleGate::allowed_N(const Eigen::Vector3d& step_m) const noexcept {
  const double steepest_N_per_m = believed_ < kLearning
                                      ? kMostStiffness_N_per_m
                                      : std::min(steepest_N_per_m_, kMostStiffness_N_per_m);
  return kSlack_N + steepest_N_per_m * step_m.norm();
}

Eigen::Vector3d SampleGate::expected_N(const Eigen::Vector3d& step_m) const noexcept {
  return force_N_ + slope_N_per_m_ * step_m;
}

void SampleGate::believe(const Sample& sample) noexcept {
  const Eigen::Vector3d step_m = sample.position_W - position_m_;
  const double step_m2 = step_m.squaredNorm();
  if (believed_ > 0 && step_m2 > kShortest_m * kShortest_m) {
    const Eigen::Vector3d change_N = sample.force_W - expected_N(step_m);
    if (change_N.norm() <= allowed_N(step_m)) {
      const double steep_N_per_m = (sample.force_W - force_N_).norm() / std::sqrt(step_m2);
      steepest_N_per_m_ = std::max(kKept * steepest_N_per_m_, steep_N_per_m);
      slope_N_per_m_ += change_N * step_m.transpose() / step_m2;
    } else {
      slope_N_per_m_.setZero();  // the object gave way
    }
  }
  position_m_ = sample.position_W;
  force_N_ = sample.force_W;
  believed_ = std::min(believed_ + 1, kLearning);
}

void SampleGate::refuse_held() noexcept {
  if (holds_) {
    holds_ = false;
    ++refused_;
    wary_ = kWary;
  }
}

}  // namespace forcegrid
