// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/motion_guard.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace forcegrid::servo {
namespace {

Fault fault_of(driver::DeviceHealth health) noexcept {
  switch (health) {
    case driver::DeviceHealth::kRunning:
      return Fault::kNone;
    case driver::DeviceHealth::kStale:
      return Fault::kStaleReports;
    case driver::DeviceHealth::kUnplugged:
      return Fault::kUnplugged;
    case driver::DeviceHealth::kTaken:
      return Fault::kInterfaceTaken;
    case driver::DeviceHealth::kSecondWriter:
      return Fault::kSecondWriter;
    case driver::DeviceHealth::kProtocol:
      return Fault::kProtocol;
    case driver::DeviceHealth::kClosed:
      return Fault::kDeviceClosed;
  }
  return Fault::kProtocol;
}

}  // namespace

MotionGuard::MotionGuard(const profiles::DeviceProfile& profile, rt::Duration report_timeout)
    : max_speed_m_per_s_(profile.limits.max_speed_m_per_s),
      max_joint_speed_rad_per_s_(profile.limits.max_joint_speed_rad_per_s.data()),
      max_joint_acceleration_rad_per_s2_(profile.limits.max_joint_acceleration_rad_per_s2.data()),
      angle_per_count_rad_(driver::angle_per_count_rad(profile)),
      report_timeout_(report_timeout),
      joint_speed_rad_per_s_(max_joint_speed_rad_per_s_) {}

Fault MotionGuard::check(rt::TimePoint now, driver::DeviceHealth health,
                         const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept {
  if (health != driver::DeviceHealth::kRunning) {
    return fault_of(health);
  }
  if (report.sequence == 0 || now - report.received > report_timeout_) {
    return Fault::kStaleReports;
  }
  const bool possible = pose.status != driver::KinematicsStatus::kNotFinite &&
                        pose.status != driver::KinematicsStatus::kOutOfRange;
  if (has_last_ && report.sequence == last_sequence_) {
    return possible ? Fault::kNone : Fault::kBadPose;
  }
  if (has_last_) {
    // One long pause is a pause, not a habit; a longer one is another fault, or the loop's own.
    const rt::Duration gap = std::min(report.received - last_received_, report_timeout_);
    const bool late = gap > kLateGap || report.received - report.oldest_release > kLateGap;
    late_s_ = std::max(0.0, late_s_ + (late ? 0.5 : -0.5) * rt::seconds(gap));
    if (late_s_ > kLateBudget_s) {
      return Fault::kLateReports;
    }
    const double elapsed_s = rt::seconds(report.released - last_sampled_);
    const Eigen::Vector3d step_D = pose.position_D - last_position_D_;
    if (const int joint = jumped(report); joint >= 0) {
      joint_ = joint;
      return distrusted(Fault::kImplausibleJump, report);
    }
    if (!possible) {
      return distrusted(Fault::kBadPose, report);
    }
    if (elapsed_s > 0.0) {
      const double share = 1.0 - std::exp(-elapsed_s / kVelocityTimeConstant_s);
      velocity_D_ += share * (step_D / elapsed_s - velocity_D_);
    }
    if (velocity_D_.norm() <= max_speed_m_per_s_) {
      slow_enough_at_ = report.released;
    } else if (report.released - slow_enough_at_ >= kTooFastFor) {
      return Fault::kTooFast;
    }
  } else if (!possible) {
    return distrusted(Fault::kBadPose, report);
  } else {
    slow_enough_at_ = report.released;
  }
  has_last_ = true;
  last_sequence_ = report.sequence;
  last_received_ = report.received;
  last_sampled_after_ = report.sampled_after;
  last_sampled_ = report.released;
  last_counts_ = report.counts;
  last_position_D_ = pose.position_D;
  return Fault::kNone;
}

int MotionGuard::jumped(const driver::DeviceReport& report) noexcept {
  Eigen::Array3d step_rad;
  for (std::size_t i = 0; i < 3; ++i) {
    const double step_counts = static_cast<double>(report.counts[i]) - last_counts_[i];
    const auto axis = static_cast<Eigen::Index>(i);
    step_rad[axis] = std::abs(step_counts) * angle_per_count_rad_[axis];
  }
  const double longest_s = rt::seconds(report.released - last_sampled_after_);
  const Eigen::Array3d fastest_rad_per_s =
      (joint_speed_rad_per_s_ + longest_s * max_joint_acceleration_rad_per_s2_)
          .min(max_joint_speed_rad_per_s_);
  const Eigen::Array3d allowed_rad =
      longest_s * fastest_rad_per_s + kJumpFloor_counts * angle_per_count_rad_;
  for (int i = 0; i < 3; ++i) {
    if (!(step_rad[i] <= allowed_rad[i])) {
      return i;
    }
  }
  const double elapsed_s = rt::seconds(report.released - last_sampled_);
  if (elapsed_s > 0.0) {
    joint_speed_rad_per_s_ = step_rad / elapsed_s;
  }
  return -1;
}

// Counters are believed to have 16 bits in the device, as all devices of this project report them.
Fault MotionGuard::distrusted(Fault otherwise, const driver::DeviceReport& report) noexcept {
  for (int i = 0; i < 3; ++i) {
    const auto low = static_cast<std::int16_t>(report.counts[static_cast<std::size_t>(i)]);
    if (low == std::numeric_limits<std::int16_t>::max() ||
        low == std::numeric_limits<std::int16_t>::min()) {
      joint_ = i;
      return Fault::kSaturatedEncoder;
    }
  }
  return otherwise;
}

}  // namespace forcegrid::servo
