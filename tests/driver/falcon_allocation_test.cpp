// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <thread>

#include "driver/falcon_device.h"
#include "forcegrid/methods.h"
#include "rt/vectors.h"
#include "scripted_falcon.h"
#include "servo_loop/servo_loop.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::servo {
namespace {

using driver::ScriptedFalcon;

// The exchange goes on beside, on the device's own thread, where it may allocate as libusb does.
TEST(FalconCycle, AllocatesNothingOnTheServoThread) {
  const auto profile = profiles::load_device_profile("falcon");
  const auto falcon = std::make_shared<ScriptedFalcon>(
      ScriptedFalcon::Script{.state = ScriptedFalcon::State::kRunning});
  falcon->set_homed(0b111);
  driver::OpenOptions open_options;
  open_options.realtime_io = false;
  open_options.stale_after = open_options.servo_silence = std::chrono::seconds(10);
  const auto device =
      driver::start_falcon_device(std::make_unique<driver::ScriptedBulkTransport>(falcon), profile,
                                  open_options, "scripted", true);
  MethodOptions grid;
  grid.grid.min_W = rt::to_vector(profile.limits.workspace_min_m);
  grid.grid.max_W = rt::to_vector(profile.limits.workspace_max_m);
  grid.grid.cells.setConstant(20);
  grid.influence_radius_m = 0.02;
  const auto method = make_force_method("forcegrid", grid);
  ServoPorts ports;
  ServoOptions options;
  options.report_timeout = std::chrono::seconds(10);
  ServoLoop loop(*device, profile, {method.get()}, ports, options);
  std::uint64_t allocations = 0;
  std::uint64_t last_sequence = 0;
  int new_reports = 0;
  for (int i = 0; i < 300; ++i) {
    falcon->set_counts(
        {static_cast<std::int16_t>(-400 + i / 4), static_cast<std::int16_t>(-400 + i / 5), -400});
    if (i % 16 == 0) {
      ArrivedSample arrived;
      arrived.sample.force_W = Eigen::Vector3d(0.0, 0.0, -0.5);
      arrived.sample.time_s = rt::seconds(rt::Clock::now().time_since_epoch());
      arrived.sample.contact_epoch = 1;
      arrived.in_contact = true;
      arrived.arrived = rt::Clock::now();
      static_cast<void>(ports.samples.push(arrived));
    }
    const rt::TimePoint now = rt::Clock::now();
    {
      const testing::AllocationCount count;
      static_cast<void>(loop.run_cycle(now, now + std::chrono::milliseconds(2)));
      allocations += count.value();
    }
    const std::uint64_t sequence = device->newest_report().sequence;
    new_reports += sequence != last_sequence ? 1 : 0;
    last_sequence = sequence;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_EQ(allocations, 0U);
  EXPECT_GT(new_reports, 50);  // the exchange really ran
}

}  // namespace
}  // namespace forcegrid::servo
