// SPDX-License-Identifier: Apache-2.0
// The bare loop of a driver: a spring toward the device's origin at 1 kHz, computed in the cycle
// itself, with all guards and limits. What a program through libHD (hd_spring.c) is compared with.
// usage: forcegrid_driver_loop DEVICE SECONDS

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <stdexcept>
#include <string>

#include "driver/open_device.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"

namespace {

using namespace forcegrid;

constexpr char kProfile[] = "woodenhaptics_v2015";
constexpr double kRate_Hz = 1000.0;
constexpr double kStiffness_N_per_m = 100.0;

class Spring final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "spring"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& /*sample*/) noexcept override {}
  void contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& /*point_W*/) noexcept override {
  }
  void contact_lost() noexcept override {}
  int work(int /*budget*/) noexcept override { return 0; }
  [[nodiscard]] ForceEstimate force(double /*time_s*/,
                                    const Eigen::Vector3d& position_W) const noexcept override {
    ForceEstimate estimate;
    estimate.force_W = -kStiffness_N_per_m * position_W;
    estimate.status = EstimateStatus::kOk;
    estimate.uncertainty_N = 0.0;
    return estimate;
  }
};

void print(const char* name, const rt::Percentiles& times_us) {
  std::printf("%s p50 %.2f p99 %.2f p999 %.2f max %.2f\n", name, times_us.at(0.5),
              times_us.at(0.99), times_us.at(0.999), times_us.max());
}

int run(const std::string& url, double seconds) {
  const profiles::DeviceProfile profile = profiles::load_device_profile(kProfile);
  const auto device = driver::open_device(url, profile);
  Spring spring;
  servo::ServoPorts ports;
  servo::ServoOptions options;
  options.rate_Hz = kRate_Hz;
  options.needs_samples = false;
  options.rendering.passivity.mode = servo::PassivityMode::kObserve;
  servo::TelemetryOptions telemetry_options;
  telemetry_options.rate_Hz = kRate_Hz;
  telemetry_options.keep_cycles = 0;
  servo::Telemetry telemetry(ports, telemetry_options);
  servo::ServoLoop loop(*device, profile, {&spring}, ports, options);
  telemetry.start();
  const std::atomic<bool> stop{false};
  const servo::ServoOutcome outcome = loop.run(stop, seconds);
  telemetry.stop();
  const servo::TelemetryStatistics& statistics = telemetry.statistics();
  print("wakeup_us", statistics.wakeup_us);
  print("compute_us", statistics.compute_us);
  std::printf("compute_p10_us %.2f\n", statistics.compute_us.at(0.1));
  std::printf("cycles %llu missed %llu realtime %d\n",
              static_cast<unsigned long long>(statistics.cycles),
              static_cast<unsigned long long>(statistics.missed_deadlines),
              outcome.scheduling.realtime ? 1 : 0);
  if (outcome.fault != servo::Fault::kNone) {
    throw std::runtime_error(servo::sentence_for(outcome.fault, outcome.joint) + " " +
                             outcome.device_failure);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const double seconds = argc == 3 ? std::strtod(argv[2], nullptr) : 0.0;
    if (!(seconds > 0.0)) {
      throw std::invalid_argument("usage: forcegrid_driver_loop DEVICE SECONDS");
    }
    return run(argv[1], seconds);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid_driver_loop: %s\n", error.what());
    return 1;
  }
}
