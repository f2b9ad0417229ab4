// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>

#include "device_emulator/device_options.h"
#include "device_emulator/operator_script.h"
#include "driver/device.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::stability {

/// The emulator's mechanism, motors, hand and operator behind the driver's interface, without USB
/// and in simulated time. The loop's commands move it. Counts are sampled 1 ms before they are
/// read, as over the bus.
class SimulatedDevice : public driver::Device {
 public:
  /// Advances to 1 ms before `now`, makes the report, then advances to `now`.
  void advance_to(rt::TimePoint now) {
    if (silent || mute) {
      move_to(now);
      return;
    }
    move_to(now - std::chrono::milliseconds(1));
    const Eigen::Vector3d counts = counts_now();
    for (std::size_t i = 0; i < 3; ++i) {
      report_.counts[i] =
          static_cast<std::int32_t>(std::lround(counts[static_cast<Eigen::Index>(i)]));
    }
    if (spoil_counts) {
      spoil_counts(now, report_.counts);
    }
    ++report_.sequence;
    report_.sampled_after = now - std::chrono::milliseconds(2);
    report_.released = report_.oldest_release = now - std::chrono::milliseconds(1);
    report_.received = now - std::chrono::microseconds(500);
    move_to(now);
  }

  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override { return report_; }
  void command(const driver::MotorCommand& command) noexcept override {
    commanded_ = command;
    if (!silent) {
      obey(command);
    }
  }
  driver::DeviceHealth health() const noexcept override { return health_shown; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return ""; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override { return true; }

  emulator::OperatorScript::Phase phase() const { return script_.phase(); }
  /// The newest command, even if it did not arrive.
  const driver::MotorCommand& commanded() const { return commanded_; }
  /// [m] of the tool, frame D.
  virtual Eigen::Vector3d position_D() const = 0;
  /// [J] Energy delivered by the motors: the integral of their positive power.
  virtual double motor_work_J() const = 0;

  /// No report arrives. The driver sends a command for each report that it gets, so the motors keep
  /// the last command.
  bool silent = false;
  /// No report arrives, but commands still reach the motors.
  bool mute = false;
  driver::DeviceHealth health_shown = driver::DeviceHealth::kRunning;
  /// Falsifies the encoder counts.
  std::function<void(rt::TimePoint, std::array<std::int32_t, 6>&)> spoil_counts;
  /// -1: leads swapped; 0: no power.
  Eigen::Vector3d motor_sign = Eigen::Vector3d::Ones();

 protected:
  SimulatedDevice(const emulator::OperatorScript::Options& script, const Eigen::Vector3d& home_D,
                  rt::TimePoint start)
      : script_(script, home_D), now_(start - std::chrono::milliseconds(2)) {}

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

 private:
  /// Of joints a, b, c, not rounded.
  virtual Eigen::Vector3d counts_now() const = 0;
  /// Sets the motors' command from now on.
  virtual void obey(const driver::MotorCommand& command) noexcept = 0;
  virtual void advance(double duration_s, const Eigen::Vector3d& hand_target_D) = 0;

  void move_to(rt::TimePoint when) {
    const auto action =
        script_.update(when, {.host_present = true, .counters_loaded = 0, .homed = true});
    advance(rt::seconds(when - now_), action.target_D);
    now_ = when;
  }

  emulator::OperatorScript script_;
  rt::TimePoint now_;
  driver::DeviceReport report_;
  driver::MotorCommand commanded_;
  driver::DeviceIdentity identity_;
};

}  // namespace forcegrid::stability
