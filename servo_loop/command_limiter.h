// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "driver/device.h"
#include "driver/force_limiter.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/encoder_watch.h"
#include "servo_loop/motor_warmth.h"

namespace forcegrid::servo {

/// Every limit between the force that is wanted and the motors' currents, in this order:
///
///   1. driver::ForceLimiter: finite input, force, slew, joint torque, current;
///   2. MotorWarmth: warm motors get less current; all joints are scaled alike;
///   3. EncoderWatch: a joint whose encoder may be stuck loses the torque of the rendered force.
///      The torque that carries the links stays, except where it opposes the force's torque: a
///      joint's torque is only shortened, never reversed.
///
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class CommandLimiter {
 public:
  /// @param watch_encoders  false: step 3 does nothing and stuck_encoder() finds none.
  CommandLimiter(const profiles::DeviceProfile& profile, bool watch_encoders);

  /// What one cycle wants of the motors.
  struct Wanted {
    Eigen::Vector3d force_D = Eigen::Vector3d::Zero();          ///< [N] of the device on the hand
    Eigen::Vector3d extra_torque_Nm = Eigen::Vector3d::Zero();  ///< gravity, motor check
    bool zero = false;  ///< a fault was found: command zero, whatever the rest says
  };

  /// Limits one cycle's command, and counts its currents as flowing until the next call.
  /// @param elapsed_s [s] since the last call, not negative; 0 allows no change of force.
  /// @returns what to command. Everything is zero but `acted` if Wanted::zero is set or an input is
  /// not finite. `force_D` and `torque_scale` leave out step 3: a joint that is relieved stands
  /// still, so its part of the force does no work on the hand.
  [[nodiscard]] driver::LimitedForce apply(rt::TimePoint now, double elapsed_s,
                                           const Wanted& wanted,
                                           const driver::ArmPose& pose) noexcept;

  /// Looks at one cycle's report. @returns the joint (0, 1, 2) whose encoder is stuck.
  [[nodiscard]] std::optional<int> stuck_encoder(rt::TimePoint now,
                                                 const driver::DeviceReport& report) noexcept;

  /// Nothing has been commanded for a while: the force grows from zero, and the encoder watch
  /// begins again. The motors stay as warm as they are.
  void restart() noexcept;

  /// See MotorWarmth::warmest().
  [[nodiscard]] double warmest_motor() const noexcept { return warmth_.warmest(); }
  /// How often a joint has been suspected of a stuck encoder, since construction.
  [[nodiscard]] std::uint64_t suspected_stuck_encoders() const noexcept {
    return encoder_watch_.suspected_stuck_encoders();
  }

 private:
  void limit_by_warmth(driver::LimitedForce& limited) const noexcept;
  void relieve(rt::TimePoint now, double elapsed_s, const driver::ArmPose& pose,
               driver::LimitedForce& limited) noexcept;

  driver::ForceLimiter limiter_;
  MotorWarmth warmth_;
  EncoderWatch encoder_watch_;
  bool watch_encoders_;
  std::array<double, 3> last_current_A_{};
};

}  // namespace forcegrid::servo
