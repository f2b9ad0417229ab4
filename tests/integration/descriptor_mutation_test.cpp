// SPDX-License-Identifier: Apache-2.0
// Ten thousand devices whose descriptors are wrong in ten thousand ways, enumerated and opened by
// the driver over user-space USB/IP. The emulator's time passes as fast as it is asked, so that a
// firmware's start-up of a second takes milliseconds.

#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <string>

#include "device_emulator/emulator_server.h"
#include "device_emulator/fault_spec.h"
#include "driver/device.h"
#include "driver/open_device.h"
#include "profiles/device_profile.h"

namespace forcegrid {
namespace {

constexpr int kSets = 10'000;
constexpr std::uint64_t kSeed = 20'160'407;
constexpr double kLongestOpen_s = 10.0;

TEST(MalformedDescriptors, NeverCrashHangOrEnableAMotor) {
  std::printf("seed %llu, %d sets\n", static_cast<unsigned long long>(kSeed), kSets);
  emulator::DeviceOptions device_options;
  device_options.profile = profiles::load_device_profile("woodenhaptics_v2015");
  device_options.operator_script.calibrated = true;
  device_options.faults = {
      emulator::parse_fault("malformed-descriptors:seed=" + std::to_string(kSeed))};
  emulator::EmulatorServer server({.listen = "127.0.0.1:0",
                                   .devices = {device_options},
                                   .pace = emulator::Pace::kAsFastAsAsked});
  server.start();
  const std::string url = "usbip://" + server.address() + "/1-1";
  driver::OpenOptions options;
  options.realtime_io = false;
  options.settle_at_open = rt::Duration::zero();

  int opened = 0;
  int refused = 0;
  double slowest_s = 0.0;
  for (int set = 0; set < kSets; ++set) {
    const std::uint64_t reports_before = server.report().reports_received;
    const rt::TimePoint begun = rt::Clock::now();
    try {
      const auto device = driver::open_device(url, device_options.profile, options);
      ++opened;
      // What was opened is a W2 device in all that matters; its motors have got zeros only.
      static_cast<void>(device->stop());
    } catch (const driver::DeviceError& error) {
      ++refused;
      ASSERT_NE(std::string(error.what()).find(url), std::string::npos)
          << "set " << set << ": " << error.what();
    }
    slowest_s = std::max(slowest_s, rt::seconds(rt::Clock::now() - begun));
    ASSERT_LT(slowest_s, kLongestOpen_s) << "set " << set;
    const emulator::EmulatorReport report = server.report();
    ASSERT_EQ(report.max_abs_current_mA, (std::array<double, 3>{})) << "set " << set;
    if (opened == 0) {
      ASSERT_EQ(report.reports_received, reports_before) << "set " << set;
    }
  }
  std::printf("%d opened, %d refused, slowest %.3f s\n", opened, refused, slowest_s);
  // The corpus bites, and does not bite everything.
  EXPECT_GT(refused, kSets / 3);
  EXPECT_GT(opened, kSets / 100);
  EXPECT_GE(server.report().faults.at(0).times, static_cast<std::uint64_t>(kSets) / 2);
}

}  // namespace
}  // namespace forcegrid
