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

MotorCheck::MotorCheck(const profiles::DeviceProfile& profile, rt::Duration period,
                       Motors motors) noexcept
    : friction_Nm_(profile.dynamics.coulomb_friction_Nm),
      push_cycles_(std::max(kLeastPushCycles,
                            static_cast<int>(std::lround(rt::seconds(kPushTime) /
                                                         std::max(1e-6, rt::seconds(period)))))) {
  if (motors == Motors::kArm || !profile.gimbal_motors.present) {
    return;
  }
  const auto& wrist = profile.gimbal_motors;
  joints_ = 2 * kArmJoints;
  counter_ = profile.gimbal.counter;
  wrist_push_Nm_ = kWristPush * wrist.max_torque_Nm;
  for (std::size_t i = 0; i < 3; ++i) {
    const double torque_per_current = wrist.torque_constant_Nm_per_A[i] * wrist.ratio[i];
    wrist_most_Nm_[i] =
        std::min(wrist.max_joint_torque_Nm[i], wrist.max_current_A[i] * torque_per_current);
    wrist_A_per_Nm_[i] = profile.gimbal.encoder_sign[i] / torque_per_current;
  }
}

int MotorCheck::joint() const noexcept {
  const int of_wrist = joint_ - kArmJoints;
  return of_wrist >= 0 && joint_ < joints_ ? counter_[static_cast<std::size_t>(of_wrist)] : joint_;
}

std::array<double, 3> MotorCheck::wrist_current_A() const noexcept {
  std::array<double, 3> current_A{};
  for (std::size_t i = 0; i < 3; ++i) {
    current_A[i] = wrist_A_per_Nm_[i] * torque_Nm_[kArmJoints + static_cast<Eigen::Index>(i)];
  }
  return current_A;
}

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

MotorCheck::Course MotorCheck::course(rt::TimePoint now, const driver::DeviceReport& report,
                                      const driver::ArmPose& pose) const noexcept {
  Course here;
  here.time_s = rt::seconds(now.time_since_epoch());
  here.angle_rad << pose.joint_angle_rad, pose.gimbal_angle_rad;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    here.counts[joint] = report.counts[i];
    here.counts[kArmJoints + joint] = report.counts[static_cast<std::size_t>(counter_[i])];
  }
  return here;
}

double MotorCheck::push_Nm(const driver::ArmPose& pose) const noexcept {
  const double harder = std::pow(kHarder, attempt_);
  if (joint_ >= kArmJoints) {
    return std::min(harder * wrist_push_Nm_,
                    wrist_most_Nm_[static_cast<std::size_t>(joint_ - kArmJoints)]);
  }
  return harder * (kPush_N * pose.jacobian_D.col(joint_).norm() +
                   kFrictions * friction_Nm_[static_cast<std::size_t>(joint_)]);
}

MotorCheck::Verdict MotorCheck::update(rt::TimePoint now, const driver::DeviceReport& report,
                                       const driver::ArmPose& pose) noexcept {
  torque_Nm_.setZero();
  if (verdict_ != Verdict::kRunning) {
    return verdict_;
  }
  const Course here = course(now, report, pose);
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
    torque_Nm_[joint_] = kSigns[static_cast<std::size_t>(push_)] * push_Nm(pose);
  }
  ++cycle_;
  return verdict_;
}

// A joint whose motor or encoder seems to be exchanged with another's; negative: none.
int MotorCheck::crossed_joint() const noexcept {
  for (Eigen::Index i = 0; i < joints_; ++i) {
    for (Eigen::Index j = i + 1; j < joints_; ++j) {
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

// All joints have passed, each by itself.
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
    if (++joint_ == joints_) {
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
