#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>

#include "device_emulator/arm_model.h"
#include "device_emulator/device_options.h"
#include "device_emulator/operator_script.h"
#include "driver/device.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::stability {

/// The emulator's arm, motors, hand and operator behind the driver's interface, without USB and in
/// simulated time: what the loop commands moves the arm. Counts are sampled 1 ms before they are
/// read, as over the bus.
class SimulatedArm final : public driver::Device {
 public:
  SimulatedArm(const profiles::DeviceProfile& profile, emulator::HandKind hand,
               emulator::MotionKind motion, std::uint64_t seed, rt::TimePoint start)
      : SimulatedArm(options(profile, hand, motion, seed), start) {}

  /// Moves the arm up to 1 ms before `now` and shows that; then up to `now`.
  void advance_to(rt::TimePoint now) {
    if (silent || mute) {
      move_to(now);
      return;
    }
    move_to(now - std::chrono::milliseconds(1));
    const Eigen::Vector3d counts = arm_.kinematics().counts(arm_.joint_angle_rad());
    for (std::size_t i = 0; i < 3; ++i) {
      report_.counts[i] =
          static_cast<std::int32_t>(std::lround(counts[static_cast<Eigen::Index>(i)]));
    }
    if (spoil_counts) {
      spoil_counts(now, report_.counts);
    }
    ++report_.sequence;
    report_.released = now - std::chrono::milliseconds(1);
    report_.received = now - std::chrono::microseconds(500);
    move_to(now);
  }

  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override { return report_; }
  void command(const driver::MotorCommand& command) noexcept override {
    if (silent) {
      return;
    }
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      current_A_[axis] = command.current_A[i] * motor_sign[axis];
    }
  }
  driver::DeviceHealth health() const noexcept override { return health_shown; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return ""; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override { return true; }

  const emulator::ArmModel& arm() const { return arm_; }
  Eigen::Vector3d position_D() const { return arm_.position_D(); }
  emulator::OperatorScript::Phase phase() const { return script_.phase(); }

  /// No report comes. The driver sends a command for each report that it gets, so that the motors
  /// keep the last one.
  bool silent = false;
  /// No report comes, but commands still arrive.
  bool mute = false;
  driver::DeviceHealth health_shown = driver::DeviceHealth::kRunning;
  /// Changes what the encoders say.
  std::function<void(rt::TimePoint, std::array<std::int32_t, 6>&)> spoil_counts;
  /// -1: leads swapped; 0: no power.
  Eigen::Vector3d motor_sign = Eigen::Vector3d::Ones();

 private:
  static emulator::DeviceOptions options(const profiles::DeviceProfile& profile,
                                         emulator::HandKind hand, emulator::MotionKind motion,
                                         std::uint64_t seed) {
    emulator::DeviceOptions options;
    options.profile = profile;
    options.hand = hand;
    options.operator_script.calibrated = true;
    options.operator_script.motion = motion;
    options.operator_script.seed = seed;
    return options;
  }

  SimulatedArm(const emulator::DeviceOptions& options, rt::TimePoint start)
      : kinematics_(options.profile),
        arm_(options.profile, options.hand_profile(), pose_angles(options.profile),
             options.hand_carries_weight),
        script_(options.operator_script, arm_.position_D()),
        now_(start - std::chrono::milliseconds(2)) {}

  static Eigen::Vector3d pose_angles(const profiles::DeviceProfile& profile) {
    const auto& counts = profile.calibration.pose_counts;
    return emulator::ArmKinematics(profile.kinematics)
        .joint_angle_rad({static_cast<double>(counts[0]), static_cast<double>(counts[1]),
                          static_cast<double>(counts[2])});
  }

  void move_to(rt::TimePoint when) {
    const auto action = script_.update(when, {.host_present = true, .counters_loaded = 0});
    arm_.advance(rt::seconds(when - now_), kinematics_.joint_torque_of_current(current_A_),
                 action.target_D);
    now_ = when;
  }

  driver::ArmKinematics kinematics_;
  emulator::ArmModel arm_;
  emulator::OperatorScript script_;
  rt::TimePoint now_;
  Eigen::Vector3d current_A_ = Eigen::Vector3d::Zero();
  driver::DeviceReport report_;
  driver::DeviceIdentity identity_;
};

}  // namespace forcegrid::stability
