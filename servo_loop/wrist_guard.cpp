// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/wrist_guard.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "driver/gimbal_kinematics.h"

namespace forcegrid::servo {
namespace {

constexpr std::size_t kFirstCounter = 3;  // d

}  // namespace

WristGuard::WristGuard(const profiles::DeviceProfile& profile) noexcept
    : gimbal_(profile.gimbal),
      max_speed_rad_per_s_(profile.gimbal.max_joint_speed_rad_per_s.data()),
      max_acceleration_rad_per_s2_(profile.gimbal.max_joint_acceleration_rad_per_s2.data()),
      angle_per_count_rad_(driver::gimbal_angle_per_count_rad(profile)),
      joint_speed_rad_per_s_(max_speed_rad_per_s_) {}

Fault WristGuard::check(const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept {
  if (!gimbal_.present || report.sequence == 0 || !pose.has_orientation ||
      (has_last_ && report.sequence == last_sequence_)) {
    return Fault::kNone;
  }
  if (has_last_) {
    if (const int joint = jumped(report); joint >= 0) {
      encoder_ = gimbal_.counter[static_cast<std::size_t>(joint)];
      const auto low = static_cast<std::int16_t>(report.counts[static_cast<std::size_t>(encoder_)]);
      const bool at_the_end = low == std::numeric_limits<std::int16_t>::max() ||
                              low == std::numeric_limits<std::int16_t>::min();
      return at_the_end ? Fault::kSaturatedEncoder : Fault::kImplausibleJump;
    }
    follow(report, pose);
    watch_travel(report, pose);
  } else {
    anchor_D_ = pose.position_D;
  }
  has_last_ = true;
  last_sequence_ = report.sequence;
  last_sampled_ = report.released;
  last_sampled_after_ = report.sampled_after;
  last_counts_ = report.counts;
  last_rotation_DT_ = pose.rotation_DT;
  return Fault::kNone;
}

int WristGuard::jumped(const driver::DeviceReport& report) noexcept {
  Eigen::Array3d step_rad;
  for (int i = 0; i < 3; ++i) {
    const auto counter = static_cast<std::size_t>(gimbal_.counter[static_cast<std::size_t>(i)]);
    const double step_counts = static_cast<double>(report.counts[counter]) - last_counts_[counter];
    step_rad[i] = std::abs(step_counts) * angle_per_count_rad_[i];
  }
  const double longest_s = rt::seconds(report.released - last_sampled_after_);
  const Eigen::Array3d fastest_rad_per_s =
      (joint_speed_rad_per_s_ + longest_s * max_acceleration_rad_per_s2_).min(max_speed_rad_per_s_);
  const Eigen::Array3d allowed_rad =
      longest_s * fastest_rad_per_s + kJumpFloor_counts * angle_per_count_rad_;
  for (int i = 0; i < 3; ++i) {
    if (!(step_rad[i] <= allowed_rad[i])) {
      return i;
    }
  }
  if (const double elapsed_s = rt::seconds(report.released - last_sampled_); elapsed_s > 0.0) {
    joint_speed_rad_per_s_ = step_rad / elapsed_s;
  }
  return -1;
}

// The rotation from the last frame to this one is exp([w] t), so its axis and angle give w.
void WristGuard::follow(const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept {
  const double elapsed_s = rt::seconds(report.released - last_sampled_);
  if (!(elapsed_s > 0.0)) {
    return;
  }
  const Eigen::AngleAxisd turned(
      Eigen::Quaterniond(Eigen::Matrix3d(pose.rotation_DT * last_rotation_DT_.transpose())));
  const double share = 1.0 - std::exp(-elapsed_s / kVelocityTimeConstant_s);
  angular_velocity_D_ += share * (turned.angle() / elapsed_s * turned.axis() - angular_velocity_D_);
}

void WristGuard::watch_travel(const driver::DeviceReport& report,
                              const driver::ArmPose& pose) noexcept {
  const double way_m = (pose.position_D - anchor_D_).norm();
  const bool stepped = way_m >= kTravelStep_m;
  if (stepped) {
    anchor_D_ = pose.position_D;
  }
  for (std::size_t i = 0; i < still_for_m_.size(); ++i) {
    const std::size_t counter = kFirstCounter + i;
    const auto bit = static_cast<std::uint8_t>(1U << i);
    if (report.counts[counter] != last_counts_[counter]) {
      still_for_m_[i] = 0.0;
      suspected_ = static_cast<std::uint8_t>(suspected_ & ~bit);
    } else if (stepped) {
      still_for_m_[i] += way_m;
      if (still_for_m_[i] >= kSuspectTravel_m) {
        suspected_ = static_cast<std::uint8_t>(suspected_ | bit);
      }
    }
  }
}

}  // namespace forcegrid::servo
