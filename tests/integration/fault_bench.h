// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "device_emulator/emulator_server.h"
#include "device_emulator/fault_spec.h"
#include "driver/kinematics.h"
#include "driver/open_device.h"
#include "forcegrid/core/force_method.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::testing {

/// A soft spring to the workspace's origin under a steady pull: a force wherever the tool is.
class SpringMethod final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "spring"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample&) noexcept override {}
  void contact_made(std::uint32_t, const Eigen::Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Eigen::Vector3d& position_W) const noexcept override {
    ForceEstimate estimate;
    estimate.force_W = -60.0 * position_W + Eigen::Vector3d(0.2, 0.2, -1.2);
    estimate.status = EstimateStatus::kOk;
    return estimate;
  }
};

/// What became of a loop whose device misbehaved.
struct FaultyRun {
  servo::ServoOutcome outcome;
  std::vector<servo::CycleRecord> records;
  driver::DeviceStatistics device;
  emulator::EmulatorReport emulator;
  /// [ms] longest time that the machine held up a bus frame or a cycle; part of any reaction time.
  double held_up_ms = 0.0;

  const servo::CycleRecord& last() const { return records.back(); }
  /// [ms] from the cycle that saw the fault until current last flowed in a motor.
  double motors_off_after_ms() const {
    return 1e-6 * static_cast<double>(emulator.motors_last_on_ns - last().time_ns);
  }
  /// [ms] from the first time that the fault acted until the cycle that saw it.
  double seen_after_ms() const {
    return 1e-6 * static_cast<double>(last().time_ns - emulator.faults.at(0).first_ns);
  }
};

/// The currents [mA], or a Falcon's commands, that the emulated motors got last and at most.
inline std::array<double, 3> last_command(const FaultyRun& run) {
  if (!run.emulator.falcon) {
    return run.emulator.final_current_mA;
  }
  const auto& command = run.emulator.falcon->final_command;
  return {static_cast<double>(command[0]), static_cast<double>(command[1]),
          static_cast<double>(command[2])};
}
inline double largest_command(const FaultyRun& run) {
  if (!run.emulator.falcon) {
    const auto& current_mA = run.emulator.max_abs_current_mA;
    return *std::max_element(current_mA.begin(), current_mA.end());
  }
  const auto& command = run.emulator.falcon->max_abs_command;
  return static_cast<double>(*std::max_element(command.begin(), command.end()));
}
inline bool is_off(const FaultyRun& run) { return last_command(run) == std::array<double, 3>{}; }
/// Whether the motors have pushed: with more than 50 mA, or more than 20 of a Falcon's units.
inline bool pushed(const FaultyRun& run) {
  return largest_command(run) > (run.emulator.falcon ? 20.0 : 50.0);
}

/// A cycle sees what is expected within 20 ms of `visible_after_ms`, by when it can be seen.
inline constexpr double kReaction_ms = 20.0;
inline void expect_seen(const FaultyRun& run, const char* fault, double visible_after_ms) {
  EXPECT_GE(run.emulator.faults.at(0).times, 1u);
  EXPECT_LE(run.seen_after_ms(), visible_after_ms + kReaction_ms + run.held_up_ms);
  EXPECT_TRUE(is_off(run));
  std::printf("%s: seen after %.1f ms, motors off %.1f ms later (machine held up %.1f ms)\n", fault,
              run.seen_after_ms(), run.motors_off_after_ms(), run.held_up_ms);
}

/// A fault that the loop lives with and the driver counts.
struct Endured {
  const char* test;
  const char* fault;
  std::uint64_t driver::DeviceStatistics::*counter;  ///< what counts it; null: nothing does
};
inline void expect_endured(const FaultyRun& run, const Endured& endured) {
  ASSERT_TRUE(pushed(run)) << servo::name_of(run.outcome.fault) << ": "
                           << run.outcome.device_failure;
  EXPECT_EQ(run.outcome.fault, servo::Fault::kNone)
      << servo::name_of(run.outcome.fault) << ": " << run.outcome.device_failure;
  EXPECT_TRUE(run.outcome.zero_current_delivered);
  EXPECT_TRUE(is_off(run));
  ASSERT_GE(run.emulator.faults.at(0).times, 1u);
  if (endured.counter != nullptr) {
    EXPECT_GE(run.device.*endured.counter, 1u);
  }
}

/// A motor of joint b that pushes the wrong way is found before any force.
inline void expect_wrong_way_motor(const FaultyRun& run) {
  EXPECT_EQ(run.outcome.fault, servo::Fault::kMotorWrongWay) << servo::name_of(run.outcome.fault);
  EXPECT_EQ(run.outcome.joint, 1);
  for (const auto& record : run.records) {
    EXPECT_EQ(record.gain, 0.0);
  }
  EXPECT_TRUE(is_off(run));
}

/// An emulated device that starts in the middle of the workspace, in a firm hand, with true
/// counters (a Falcon also with its firmware running); its driver and a servo loop, in this
/// process.
class FaultBench {
 public:
  /// @param fault see FaultSpec; empty: none.
  explicit FaultBench(const std::string& fault,
                      emulator::MotionKind motion = emulator::MotionKind::kLissajous,
                      const char* profile = "woodenhaptics_v2015") {
    options_.profile = profiles::load_device_profile(profile);
    if (options_.profile.kind == profiles::DeviceKind::kDelta) {
      options_.firmware_loaded = true;
    } else {
      // The counts of the workspace's origin; sheet, 11.4.
      options_.profile.calibration.pose_counts = {0, 1313, 2535, 0, 0, 0};
      if (std::string(profile) == "phantom_desktop") {
        const auto counts =
            driver::ArmKinematics(options_.profile).inverse(Eigen::Vector3d::Zero()).counts;
        for (int i = 0; i < 3; ++i) {
          options_.profile.calibration.pose_counts[static_cast<std::size_t>(i)] =
              static_cast<int>(std::lround(counts[i]));
        }
      }
    }
    options_.operator_script.calibrated = true;
    options_.operator_script.motion = motion;
    if (!fault.empty()) {
      options_.faults = {emulator::parse_fault(fault)};
    }
  }

  emulator::DeviceOptions& options() { return options_; }

  /// Called every 20 ms while the loop runs, with the newest record's time since the first.
  std::function<void(emulator::EmulatorServer&, double seconds)> meanwhile;

  /// @param check_motors see ServoOptions.
  /// @param settle how long the emulator runs on, so that its watchdog may trip.
  FaultyRun run(double seconds, bool check_motors = false,
                std::chrono::milliseconds settle = std::chrono::milliseconds(0)) {
    emulator::EmulatorServer server({.listen = "127.0.0.1:0", .devices = {options_}});
    server.start();
    FaultyRun result;
    const auto device =
        driver::open_device("usbip://" + server.address() + "/1-1", options_.profile);
    SpringMethod method;
    servo::ServoPorts ports;
    servo::ServoOptions servo_options;
    servo_options.check_motors = check_motors;
    servo_options.rendering.ladder.ramp_in_s = 0.1;
    // The method's pull comes into being around the tool: the guard would shorten it.
    servo_options.rendering.passivity.mode = servo::PassivityMode::kObserve;
    servo::ServoLoop loop(*device, options_.profile, {&method}, ports, servo_options);
    const std::atomic<bool> stop{false};
    std::atomic<bool> ended{false};
    std::thread servo([&] {
      result.outcome = loop.run(stop, seconds);
      ended = true;
    });
    const auto drain = [&] {
      servo::CycleRecord record;
      while (ports.records.pop(record)) {
        result.records.push_back(record);
        result.held_up_ms = std::max(result.held_up_ms, 1e-3 * record.period_us - 2.0);
      }
    };
    while (!ended) {
      servo::ArrivedSample arrived;
      arrived.in_contact = true;
      arrived.arrived = rt::Clock::now();
      static_cast<void>(ports.samples.push(arrived));
      drain();
      if (meanwhile && !result.records.empty()) {
        meanwhile(server, 1e-9 * static_cast<double>(result.records.back().time_ns -
                                                     result.records.front().time_ns));
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    servo.join();
    drain();
    std::this_thread::sleep_for(settle);
    result.device = device->statistics();
    result.emulator = server.report();
    result.held_up_ms += 1e-3 * result.emulator.worst_lateness_us;
    server.stop();
    return result;
  }

 private:
  emulator::DeviceOptions options_;
};

}  // namespace forcegrid::testing
