// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>

#include "servo_loop/servo_loop.h"
#include "tests/servo_loop/scripted_device.h"
#include "tests/servo_loop/spoken_method.h"

namespace forcegrid::servo {

/// The loop with a scripted device and a spoken method, cycle by cycle in scripted time.
class LoopBench : public ::testing::Test {
 protected:
  static constexpr rt::Duration kPeriod = std::chrono::milliseconds(2);
  static constexpr int kCyclesPerSample = 16;

  explicit LoopBench(const ServoOptions& changed = options())
      : profile_(profiles::load_device_profile("woodenhaptics_v2015")),
        device_(profile_),
        loop_(device_, profile_, {&method_}, ports_, changed) {}

  static ServoOptions options() {
    ServoOptions options;
    options.rendering.ladder.ramp_in_s = 0.1;
    options.rendering.ladder.fade_s = 0.1;
    // A scripted device does not move by what it is told.
    options.check_motors = false;
    options.watch_encoders = false;
    return options;
  }

  void arrive(const Eigen::Vector3d& force_W, bool in_contact = true, std::uint32_t epoch = 1) {
    ArrivedSample arrived;
    arrived.sample.force_W = force_W;
    arrived.sample.contact_epoch = epoch;
    arrived.sample.time_s = rt::seconds(now_.time_since_epoch());
    arrived.in_contact = in_contact;
    arrived.arrived = now_;
    ASSERT_TRUE(ports_.samples.push(arrived));
  }

  /// One cycle with the tool at `position_D`, a fresh report and, every 32 ms, a fresh sample.
  Fault cycle(const Eigen::Vector3d& position_D = Eigen::Vector3d::Zero(),
              bool with_samples = true) {
    now_ += kPeriod;
    device_.show(position_D, now_ - std::chrono::milliseconds(1));
    if (with_samples && cycles_++ % kCyclesPerSample == 0) {
      arrive(method_.force_W);
    }
    return loop_.run_cycle(now_, now_ + kPeriod);
  }

  /// The last record, and none left behind.
  CycleRecord record() {
    CycleRecord last;
    while (ports_.records.pop(last)) {
    }
    return last;
  }

  static bool is_zero(const driver::MotorCommand& command) {
    return command.current_A == std::array<double, 3>{} &&
           command.joint_torque_Nm == std::array<double, 3>{};
  }

  profiles::DeviceProfile profile_;
  ScriptedDevice device_;
  SpokenMethod method_;
  ServoPorts ports_;
  ServoLoop loop_;
  rt::TimePoint now_ = rt::TimePoint(std::chrono::seconds(1000));
  int cycles_ = 0;
};

}  // namespace forcegrid::servo
