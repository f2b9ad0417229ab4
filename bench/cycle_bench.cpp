// SPDX-License-Identifier: Apache-2.0
// The whole computation of one servo cycle: report, forward kinematics, query, limits, J^T,
// command, and a fill step of 64 vertices; everything from wake-up to sleep.

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <memory>

#include "bench/ratios.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::bench {
namespace {

// Reports without a bus, so that the benchmark measures the loop, not a transport.
class CountsOnly final : public driver::Device {
 public:
  const driver::DeviceIdentity& identity() const noexcept override { return identity_; }
  driver::DeviceReport newest_report() noexcept override { return report; }
  void command(const driver::MotorCommand& command) noexcept override {
    benchmark::DoNotOptimize(command);
  }
  driver::DeviceHealth health() const noexcept override { return driver::DeviceHealth::kRunning; }
  driver::DeviceStatistics statistics() const noexcept override { return {}; }
  std::string failure() const override { return {}; }
  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {}
  bool stop() noexcept override { return true; }
  driver::DeviceReport report;

 private:
  driver::DeviceIdentity identity_;
};

void servo_cycle(benchmark::State& state) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  const driver::ArmKinematics kinematics(profile);
  MethodOptions grid;
  grid.grid.min_W = rt::to_vector(profile.limits.workspace_min_m);
  grid.grid.max_W = rt::to_vector(profile.limits.workspace_max_m);
  grid.grid.cells.setConstant(49);
  grid.influence_radius_m = 0.16 / 6;
  const std::unique_ptr<ForceMethod> method = make_force_method("forcegrid", grid);
  CountsOnly device;
  servo::ServoPorts ports;
  servo::ServoOptions options;
  options.fill_budget = 64;
  servo::ServoLoop loop(device, profile, {method.get()}, ports, options);
  rt::TimePoint now = rt::Clock::now();
  std::int64_t cycle = 0;
  servo::CycleRecord record;
  for (auto _ : state) {
    state.PauseTiming();
    now = rt::Clock::now();
    const double phase = 2e-3 * static_cast<double>(cycle);
    const Eigen::Vector3d counts =
        kinematics
            .inverse(Eigen::Vector3d(0.01 * std::sin(phase), 0.01 * std::cos(1.3 * phase),
                                     0.01 * (1.0 - std::cos(1.7 * phase))))
            .counts;
    for (int axis = 0; axis < 3; ++axis) {
      device.report.counts[static_cast<std::size_t>(axis)] =
          static_cast<std::int32_t>(std::lround(counts[axis]));
    }
    ++device.report.sequence;
    // Two milliseconds of device time per report, as at 500 Hz.
    device.report.received = now;
    device.report.released = rt::TimePoint(std::chrono::milliseconds(2) * cycle);
    device.report.sampled_after = device.report.released - std::chrono::milliseconds(1);
    device.report.oldest_release = device.report.received;
    if (cycle % 16 == 0) {
      servo::ArrivedSample arrived;
      arrived.in_contact = true;
      arrived.arrived = now;
      arrived.sample.force_W = Eigen::Vector3d(0.0, 0.0, -1.0);
      arrived.sample.contact_epoch = 1;
      arrived.sample.time_s = rt::seconds(now.time_since_epoch());
      static_cast<void>(ports.samples.push(arrived));
    }
    static_cast<void>(ports.records.pop(record));
    ++cycle;
    state.ResumeTiming();
    if (loop.run_cycle(now, now) != servo::Fault::kNone) {
      state.SkipWithError("the cycle ended in a fault");
      break;
    }
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(servo_cycle);

const bool registered = [] {
  report_time("servo_cycle", "<= 5000 ns");
  return true;
}();

}  // namespace
}  // namespace forcegrid::bench
