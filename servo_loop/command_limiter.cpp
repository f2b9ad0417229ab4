// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/command_limiter.h"

#include <algorithm>

namespace forcegrid::servo {

CommandLimiter::CommandLimiter(const profiles::DeviceProfile& profile, bool watch_encoders)
    : limiter_(profile),
      warmth_(profile),
      encoder_watch_(profile),
      watch_encoders_(watch_encoders) {}

driver::LimitedForce CommandLimiter::apply(rt::TimePoint now, double elapsed_s,
                                           const Wanted& wanted,
                                           const driver::ArmPose& pose) noexcept {
  driver::LimitedForce limited =
      limiter_.apply(wanted.force_D, pose, elapsed_s, wanted.extra_torque_Nm);
  warmth_.advance(elapsed_s, last_current_A_);
  limit_by_warmth(limited);
  if (wanted.zero || (limited.acted & driver::kLimitNotFinite) != 0) {
    const std::uint8_t acted = limited.acted;
    limited = {};
    limited.acted = acted;
  } else if (watch_encoders_) {
    relieve(now, elapsed_s, pose, limited);
  }
  last_current_A_ = limited.current_A;
  return limited;
}

void CommandLimiter::limit_by_warmth(driver::LimitedForce& limited) const noexcept {
  const double scale = warmth_.scale(limited.current_A);
  if (scale < 1.0) {
    for (double& current_A : limited.current_A) {
      current_A *= scale;
    }
    limited.joint_torque_Nm *= scale;
    limited.torque_scale *= scale;
    limited.acted = static_cast<std::uint8_t>(limited.acted | driver::kLimitWarm);
  }
}

void CommandLimiter::relieve(rt::TimePoint now, double elapsed_s, const driver::ArmPose& pose,
                             driver::LimitedForce& limited) noexcept {
  const Eigen::Vector3d force_torque_Nm = pose.jacobian_D.transpose() * limited.force_D;
  const Eigen::Array3d part = encoder_watch_.relief(now, elapsed_s, force_torque_Nm);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    const double torque_Nm = limited.joint_torque_Nm[axis];
    if (part[axis] >= 1.0 || torque_Nm == 0.0) {
      continue;
    }
    // A limit may have scaled the torque down already: remove no more than is left.
    const double left_Nm = torque_Nm - (1.0 - part[axis]) * force_torque_Nm[axis];
    const double ratio = std::clamp(left_Nm / torque_Nm, 0.0, 1.0);
    limited.joint_torque_Nm[axis] *= ratio;
    limited.current_A[i] *= ratio;
  }
}

std::optional<int> CommandLimiter::stuck_encoder(rt::TimePoint now,
                                                 const driver::DeviceReport& report) noexcept {
  return watch_encoders_ ? encoder_watch_.check(now, report) : std::nullopt;
}

void CommandLimiter::restart() noexcept {
  limiter_.reset();
  encoder_watch_.restart();
}

}  // namespace forcegrid::servo
