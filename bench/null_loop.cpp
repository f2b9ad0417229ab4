// SPDX-License-Identifier: Apache-2.0
// The servo loop alone: real cycles, all recorded, with a device that answers at once and moves
// nothing. bench/realtime.py runs it in turns with cyclictest.

#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "driver/device.h"
#include "driver/kinematics.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"
#include "tools/recorder.h"

namespace {

using namespace forcegrid;

const Eigen::Vector3d kTool_D(0.0, 0.0, 0.05);

// Its tool stands still; every query returns a fresh report.
class NullDevice final : public driver::Device {
 public:
  explicit NullDevice(const profiles::DeviceProfile& profile) {
    const Eigen::Vector3d counts = driver::ArmKinematics(profile).inverse(kTool_D).counts;
    for (int i = 0; i < 3; ++i) {
      report_.counts[static_cast<std::size_t>(i)] =
          static_cast<std::int32_t>(std::lround(counts[i]));
    }
  }

  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override {
    ++report_.sequence;
    report_.sampled_after = report_.released = report_.oldest_release = report_.received =
        rt::Clock::now();
    return report_;
  }
  void command(const driver::MotorCommand&) noexcept override {}
  driver::DeviceHealth health() const noexcept override { return driver::DeviceHealth::kRunning; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return ""; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override { return true; }

 private:
  driver::DeviceReport report_;
  driver::DeviceIdentity identity_;
};

double number(const char* text, const char* name, double low, double high) {
  char* end = nullptr;
  const double value = std::strtod(text, &end);
  if (end == text || *end != '\0' || !(value >= low && value <= high)) {
    throw std::invalid_argument(std::string(name) + " '" + text + "' is not a number from " +
                                std::to_string(low) + " to " + std::to_string(high));
  }
  return value;
}

void print_wakeups(const servo::TelemetryStatistics& statistics) {
  const rt::Percentiles& wakeup_us = statistics.wakeup_us;
  std::printf("wakeup_us p50 %.2f p99 %.2f p999 %.2f max %.2f missed %llu cycles %llu\n",
              wakeup_us.at(0.5), wakeup_us.at(0.99), wakeup_us.at(0.999), wakeup_us.max(),
              static_cast<unsigned long long>(statistics.missed_deadlines),
              static_cast<unsigned long long>(statistics.cycles));
}

int run(const std::string& file, double rate_Hz, double seconds) {
  const profiles::DeviceProfile profile = profiles::load_device_profile("woodenhaptics_v2015");
  NullDevice device(profile);
  MethodOptions method_options;
  method_options.grid.min_W.setConstant(-0.1);
  method_options.grid.max_W.setConstant(0.1);
  method_options.grid.cells.setConstant(49);
  method_options.influence_radius_m = 0.03;
  const auto method = make_force_method("forcegrid", method_options);

  tools::RecorderOptions recording;
  recording.file = file;
  recording.rate_Hz = rate_Hz;
  recording.method_names = {"forcegrid"};
  recording.attributes = {{"device_url", "null"}, {"profile_name", profile.name}};
  tools::Recorder recorder(recording);

  servo::ServoPorts ports;
  servo::ServoOptions options;
  options.rate_Hz = rate_Hz;
  options.check_motors = false;
  servo::TelemetryOptions telemetry_options;
  telemetry_options.method_names = recording.method_names;
  telemetry_options.on_cycle = [&](const servo::CycleRecord& cycle) { recorder.push(cycle); };
  servo::Telemetry telemetry(ports, telemetry_options);
  servo::ServoLoop loop(device, profile, {method.get()}, ports, options);
  telemetry.start();
  const std::atomic<bool> stop{false};
  const servo::ServoOutcome outcome = loop.run(stop, seconds);
  telemetry.stop();
  print_wakeups(telemetry.statistics());
  if (!outcome.scheduling.realtime) {
    std::fprintf(stderr, "no real-time scheduling: %s\n", outcome.scheduling.reason.c_str());
  }
  if (outcome.fault != servo::Fault::kNone) {
    throw std::runtime_error(servo::sentence_for(outcome.fault, outcome.joint));
  }
  if (!recorder.finish().trouble.empty()) {
    throw std::runtime_error(recorder.finish().trouble);
  }
  return outcome.scheduling.realtime ? 0 : 3;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 4) {
      throw std::invalid_argument("usage: forcegrid_null_loop FILE.h5 RATE_HZ SECONDS");
    }
    return run(argv[1], number(argv[2], "RATE_HZ", 100.0, 4000.0),
               number(argv[3], "SECONDS", 0.1, 3600.0));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid_null_loop: %s\n", error.what());
    return 1;
  }
}
