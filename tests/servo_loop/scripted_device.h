// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "driver/device.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::servo {

/// A device for tests of the loop alone: it shows what the test says and keeps what it was told.
class ScriptedDevice final : public driver::Device {
 public:
  explicit ScriptedDevice(const profiles::DeviceProfile& profile) : kinematics_(profile) {
    commands.reserve(10000);
  }

  /// The next report has the tool at `position_D`, sampled and received at `when`.
  void show(const Eigen::Vector3d& position_D, rt::TimePoint when) { show(position_D, when, when); }
  /// The same, of an OUT that was handed over at `sent`.
  void show(const Eigen::Vector3d& position_D, rt::TimePoint when, rt::TimePoint sent) {
    const Eigen::Vector3d counts = kinematics_.inverse(position_D).counts;
    for (int i = 0; i < 3; ++i) {
      report.counts[static_cast<std::size_t>(i)] =
          static_cast<std::int32_t>(std::lround(counts[i]));
    }
    ++report.sequence;
    report.sampled_after = sent;
    report.released = report.oldest_release = when;
    report.received = when;
  }

  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override { return report; }
  void command(const driver::MotorCommand& command) noexcept override {
    if (commands.size() < commands.capacity()) {
      commands.push_back(command);
    }
  }
  driver::DeviceHealth health() const noexcept override { return state; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return "the test said so"; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override {
    stopped = true;
    return delivers_zero;
  }

  driver::DeviceReport report;
  driver::DeviceHealth state = driver::DeviceHealth::kRunning;
  std::vector<driver::MotorCommand> commands;
  bool stopped = false;
  bool delivers_zero = true;

 private:
  driver::ArmKinematics kinematics_;
  driver::DeviceIdentity identity_;
};

}  // namespace forcegrid::servo
