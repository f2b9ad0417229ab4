#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "device_emulator/emulator_server.h"
#include "device_emulator/fault_spec.h"
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
      // Sheet, 11.4: the counts of the workspace's origin.
      options_.profile.calibration.pose_counts = {0, 1313, 2535, 0, 0, 0};
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
