// SPDX-License-Identifier: Apache-2.0
// Descriptors that are wrong in many ways, through the kernel's own enumeration and whatever of the
// device it then hands to the program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/faulty_run.h"
#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr int kSetsOfAScenario = 5;

struct Survived {
  int not_enumerated = 0;
  int refused = 0;
  int opened = 0;
};

/// One set: an emulator of its own, so that its report is about that set alone. Whatever the kernel
/// makes of the device, the program ends by itself, and one that it refuses gets no command.
void expect_set_is_survived(const std::string& profile, int seed, Survived& survived) {
  SCOPED_TRACE("seed " + std::to_string(seed));
  const bool falcon = profile == "falcon";
  const std::string folder = forcegrid::testing::fresh_folder("malformed");
  std::vector<std::string> command = {
      "emulate",        "--device",
      profile,          "--listen",
      "127.0.0.1:3240", "--calibrated",
      "--fault",        "malformed-descriptors:seed=" + std::to_string(seed),
      "--json",         folder + "/report.json"};
  if (falcon) {
    command.emplace_back("--firmware-loaded");
  }
  Program emulator = Program::forcegrid(command);
  ASSERT_TRUE(emulator.wait_for_text("busid 1-1"));
  shell("usbip attach -r 127.0.0.1 -b 1-1");
  // The kernel's attempts at it, and the second that the firmware takes to start.
  std::this_thread::sleep_for(milliseconds(1500));
  shell("udevadm settle --timeout=20");
  bool refused = false;
  if (!falcon && nodes().empty()) {
    ++survived.not_enumerated;
  } else {
    // By its node, so that changed numbers don't keep the program from looking at it.
    const std::string url = falcon ? "falcon" : "hid:" + nodes()[0].dev();
    std::vector<std::string> options = {"--no-motor-check"};
    if (!falcon) {
      options.emplace_back("--calibrated");
    }
    // Half a second is too short to reach the object: no force is called for.
    Program program = Program::forcegrid(run_arguments(url, 0.5, folder, options));
    const auto status = program.wait(seconds(20));
    ASSERT_TRUE(status.has_value()) << "it hangs";
    refused = *status == 1;
    EXPECT_TRUE(*status == 0 || refused) << "status " << *status << "\n"
                                         << program.standard_error();
    ++(refused ? survived.refused : survived.opened);
  }
  shell("usbip detach -p 0");
  emulator.send_signal(SIGTERM);
  EXPECT_EQ(emulator.wait(seconds(20)).value_or(-1), 128 + SIGTERM) << emulator.standard_error();
  std::ifstream file(folder + "/report.json");
  const auto report = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(report.is_object());
  EXPECT_EQ(largest_command(report), 0.0);
  if (refused) {
    EXPECT_EQ(number(report, "reports_received"), 0) << "the motors were enabled";
  }
  for (int i = 0; i < 200 && !nodes().empty(); ++i) {
    std::this_thread::sleep_for(milliseconds(20));
  }
  EXPECT_TRUE(nodes().empty());
}

void expect_sets_are_survived(const std::string& profile, int first_seed) {
  covers_device(profile);
  covers_host("kernel");
  covers_host(profile == "falcon" ? "forcegrid-libusb" : "forcegrid-hidraw");
  Survived survived;
  for (int seed = first_seed; seed < first_seed + kSetsOfAScenario; ++seed) {
    expect_set_is_survived(profile, seed, survived);
  }
  expect_sound_kernel();
  measured("not_enumerated", survived.not_enumerated, "1");
  measured("refused", survived.refused, "1");
  measured("opened", survived.opened, "1");
}

void expect_w2_sets_are_survived(int first_seed) {
  expect_sets_are_survived("woodenhaptics_v2015", first_seed);
}

TEST(LongMalformed, DescriptorSets1To5) { expect_w2_sets_are_survived(1); }
TEST(LongMalformed, DescriptorSets6To10) { expect_w2_sets_are_survived(6); }
TEST(LongMalformed, DescriptorSets11To15) { expect_w2_sets_are_survived(11); }
TEST(LongMalformed, DescriptorSets16To20) { expect_w2_sets_are_survived(16); }
TEST(LongMalformed, DescriptorSets21To25) { expect_w2_sets_are_survived(21); }
TEST(LongMalformed, DescriptorSets26To30) { expect_w2_sets_are_survived(26); }
TEST(LongMalformed, DescriptorSets31To35) { expect_w2_sets_are_survived(31); }
TEST(LongMalformed, DescriptorSets36To40) { expect_w2_sets_are_survived(36); }
TEST(LongMalformed, DescriptorSets41To45) { expect_w2_sets_are_survived(41); }
TEST(LongMalformed, DescriptorSets46To50) { expect_w2_sets_are_survived(46); }

TEST(LongMalformed, DescriptorSetsOfAFalcon) { expect_sets_are_survived("falcon", 1); }

}  // namespace
}  // namespace forcegrid::hil
