#include "servo_loop/motion_guard.h"

#include <cmath>

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
    case driver::DeviceHealth::kProtocol:
      return Fault::kProtocol;
    case driver::DeviceHealth::kClosed:
      return Fault::kDeviceClosed;
  }
  return Fault::kProtocol;
}

}  // namespace

MotionGuard::MotionGuard(const profiles::DeviceProfile& profile, rt::Duration report_timeout)
    : max_speed_m_per_s_(profile.limits.max_speed_m_per_s), report_timeout_(report_timeout) {}

Fault MotionGuard::check(rt::TimePoint now, driver::DeviceHealth health,
                         const driver::DeviceReport& report, const driver::ArmPose& pose) noexcept {
  if (health != driver::DeviceHealth::kRunning) {
    return fault_of(health);
  }
  if (report.sequence == 0 || now - report.received > report_timeout_) {
    return Fault::kStaleReports;
  }
  if (pose.status == driver::KinematicsStatus::kNotFinite ||
      pose.status == driver::KinematicsStatus::kOutOfRange) {
    return Fault::kBadPose;
  }
  if (has_last_ && report.sequence == last_sequence_) {
    return Fault::kNone;
  }
  if (has_last_) {
    const double elapsed_s = rt::seconds(report.released - last_sampled_);
    const Eigen::Vector3d step_D = pose.position_D - last_position_D_;
    // A late completion stamps counts late, never early: the last ones may have been sampled at any
    // time since the ones before them.
    const double longest_s = rt::seconds(report.released - sampled_before_last_);
    if (!(step_D.norm() <= kJumpFloor_m + kJumpFactor * max_speed_m_per_s_ * longest_s)) {
      return Fault::kImplausibleJump;
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
  } else {
    slow_enough_at_ = report.released;
    last_sampled_ = report.released;
  }
  has_last_ = true;
  last_sequence_ = report.sequence;
  sampled_before_last_ = last_sampled_;
  last_sampled_ = report.released;
  last_position_D_ = pose.position_D;
  return Fault::kNone;
}

}  // namespace forcegrid::servo
