#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>

#include "device_emulator/delta_model.h"
#include "device_emulator/device_options.h"
#include "device_emulator/emulated_falcon.h"
#include "device_emulator/operator_script.h"
#include "driver/device.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::stability {

/// The same as SimulatedArm for the emulator's Falcon, homed: without its serial line, in simulated
/// time. Counts are sampled 1 ms before they are read.
class SimulatedFalcon final : public driver::Device {
 public:
  SimulatedFalcon(const profiles::DeviceProfile& profile, emulator::HandKind hand,
                  emulator::MotionKind motion, std::uint64_t seed, rt::TimePoint start)
      : SimulatedFalcon(options(profile, hand, motion, seed), start) {}

  /// Moves the knob up to 1 ms before `now` and shows that; then up to `now`.
  void advance_to(rt::TimePoint now) {
    if (silent) {
      move_to(now);
      return;
    }
    move_to(now - std::chrono::milliseconds(1));
    for (std::size_t i = 0; i < 3; ++i) {
      const double angle_rad = delta_.joint_angle_rad()[static_cast<Eigen::Index>(i)];
      report_.counts[i] = static_cast<std::int32_t>(
          std::lround((angle_rad - profile_.zero_angle_rad) / profile_.encoder_rad_per_count));
    }
    ++report_.sequence;
    report_.released = now - std::chrono::milliseconds(1);
    report_.received = now - std::chrono::microseconds(500);
    move_to(now);
  }

  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override { return report_; }
  void command(const driver::MotorCommand& command) noexcept override {
    if (!silent) {
      torque_Nm_ = Eigen::Vector3d(command.joint_torque_Nm[0], command.joint_torque_Nm[1],
                                   command.joint_torque_Nm[2]);
    }
  }
  driver::DeviceHealth health() const noexcept override { return driver::DeviceHealth::kRunning; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return ""; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override { return true; }

  Eigen::Vector3d position_D() const { return delta_.position_D(); }

  /// No report comes, and no command arrives.
  bool silent = false;

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

  static Eigen::Vector3d start_D() { return {0.0, 0.0, emulator::EmulatedFalcon::kStartHeight_m}; }

  SimulatedFalcon(const emulator::DeviceOptions& options, rt::TimePoint start)
      : profile_(options.profile.delta),
        delta_(options.profile, options.hand_profile(), start_D(), options.hand_carries_weight),
        script_(options.operator_script, start_D()),
        now_(start - std::chrono::milliseconds(2)) {}

  void move_to(rt::TimePoint when) {
    const auto action =
        script_.update(when, {.host_present = true, .counters_loaded = 0, .homed = true});
    delta_.advance(rt::seconds(when - now_), torque_Nm_, action.target_D);
    now_ = when;
  }

  profiles::DeviceProfile::Delta profile_;
  emulator::DeltaModel delta_;
  emulator::OperatorScript script_;
  rt::TimePoint now_;
  Eigen::Vector3d torque_Nm_ = Eigen::Vector3d::Zero();
  driver::DeviceReport report_;
  driver::DeviceIdentity identity_;
};

}  // namespace forcegrid::stability
