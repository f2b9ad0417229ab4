// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/motor_check.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::servo {
namespace {

constexpr std::array<double, 4> kSigns = {1.0, -1.0, -1.0, 1.0};
// A push must overcome the friction on top of moving something.
constexpr double kFrictions = 2.0;

}  // namespace

MotorCheck::MotorCheck(const profiles::DeviceProfile& profile, rt::Duration period) noexcept
    : friction_Nm_(profile.dynamics.coulomb_friction_Nm),
      push_cycles_(std::max(kLeastPushCycles,
                            static_cast<int>(std::lround(rt::seconds(kPushTime) /
                                                         std::max(1e-6, rt::seconds(period)))))) {}

void MotorCheck::restart() noexcept {
  if (verdict_ == Verdict::kRunning) {
    begin_attempt();
  }
}

void MotorCheck::begin_attempt() noexcept {
  push_ = 0;
  cycle_ = 0;
  answer_rad_.setZero();
  answer_counts_.setZero();
  torque_Nm_.setZero();
}

MotorCheck::Verdict MotorCheck::update(rt::TimePoint now, const driver::DeviceReport& report,
                                       const driver::ArmPose& pose) noexcept {
  torque_Nm_.setZero();
  if (verdict_ != Verdict::kRunning) {
    return verdict_;
  }
  const auto axis = static_cast<Eigen::Index>(joint_);
  const Course here{
      .time_s = rt::seconds(now.time_since_epoch()),
      .angle_rad = pose.joint_angle_rad,
      .counts = {static_cast<double>(report.counts[0]), static_cast<double>(report.counts[1]),
                 static_cast<double>(report.counts[2])}};
  const int rest = kRestPushes * push_cycles_;
  if (cycle_ == rest - push_cycles_) {
    before_ = here;
  }
  if (cycle_ == rest) {
    begin_ = here;
  }
  if (cycle_ == rest + push_cycles_) {
    // A cycle may be late: the course before the push is taken at its own speed.
    const double ratio = (here.time_s - begin_.time_s) / (begin_.time_s - before_.time_s);
    const double sign = kSigns[static_cast<std::size_t>(push_)];
    answer_rad_ +=
        sign * (here.angle_rad - begin_.angle_rad - ratio * (begin_.angle_rad - before_.angle_rad));
    answer_counts_ +=
        sign * (here.counts - begin_.counts - ratio * (begin_.counts - before_.counts));
    cycle_ = 0;
    if (++push_ == static_cast<int>(kSigns.size())) {
      return judge();
    }
  }
  if (cycle_ >= rest) {
    torque_Nm_[axis] = kSigns[static_cast<std::size_t>(push_)] * std::pow(kHarder, attempt_) *
                       (kPush_N * pose.jacobian_D.col(axis).norm() +
                        kFrictions * friction_Nm_[static_cast<std::size_t>(joint_)]);
  }
  ++cycle_;
  return verdict_;
}

// A joint whose motor or encoder seems to be exchanged with another's; negative: none.
int MotorCheck::crossed_joint() const noexcept {
  for (Eigen::Index i = 0; i < 3; ++i) {
    for (Eigen::Index j = i + 1; j < 3; ++j) {
      const double cross = answers_rad_(i, j) * answers_rad_(j, i);
      const double own = answers_rad_(i, i) * answers_rad_(j, j);
      const double counts =
          std::min(std::abs(answers_counts_(i, j)), std::abs(answers_counts_(j, i)));
      if (counts >= kLeastAnswer_counts && cross > kCrossed * own) {
        return static_cast<int>(j);
      }
    }
  }
  return -1;
}

// All three joints have passed, each by itself.
MotorCheck::Verdict MotorCheck::judge_all() noexcept {
  const int crossed = crossed_joint();
  if (crossed < 0) {
    return Verdict::kPassed;
  }
  if (!crossed_before_) {
    crossed_before_ = true;
    joint_ = 0;
    return Verdict::kRunning;
  }
  joint_ = crossed;
  return Verdict::kWrongWay;
}

MotorCheck::Verdict MotorCheck::judge() noexcept {
  const auto axis = static_cast<Eigen::Index>(joint_);
  const bool answered = std::abs(answer_counts_[axis]) >= kLeastAnswer_counts;
  if (answered && answer_rad_[axis] > 0.0) {
    attempt_ = 0;
    negative_ = 0;
    answers_rad_.col(axis) = answer_rad_;
    answers_counts_.col(axis) = answer_counts_;
    if (++joint_ == 3) {
      verdict_ = judge_all();
    }
  } else {
    negative_ += answered ? 1 : 0;
    ++attempt_;
    if (negative_ == 2) {
      verdict_ = Verdict::kWrongWay;
    } else if (attempt_ == kAttempts) {
      verdict_ = Verdict::kNoAnswer;
    }
  }
  begin_attempt();
  return verdict_;
}

}  // namespace forcegrid::servo
