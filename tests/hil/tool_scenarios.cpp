// SPDX-License-Identifier: Apache-2.0
// What `forcegrid devices` says to the users of a real kernel with udev, and whether `doctor --fix`
// mends it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

TEST(Tools, DevicesIsReadyForAMemberAndTellsAVisitorWhichGroup) {
  const Bench bench;
  const Answer member = ask("operator", "devices");
  EXPECT_EQ(member.status, 0);
  const json devices = member.result.value("devices", json::array());
  ASSERT_EQ(devices.size(), 1U);
  EXPECT_EQ(devices[0].at("node"), bench.node().dev());
  EXPECT_EQ(devices[0].at("url"), "hid:path=" + bench.node().port);
  EXPECT_TRUE(devices[0].at("obstacles").empty()) << devices.dump(2);
  const Answer visitor = ask("visitor", "devices");
  EXPECT_EQ(visitor.status, kNoneUsable);
  EXPECT_EQ(obstacle(visitor).at("kind"), "permission");
  EXPECT_EQ(obstacle(visitor).at("remedy"), "sudo usermod -aG plugdev visitor, then log in again");
}

TEST(LongTools, DevicesNamesTheMissingRuleAndDoctorInstallsIt) {
  const RuleTakenAway before_installation;
  {
    Bench bench;
    const Answer without = ask("operator", "devices");
    EXPECT_EQ(without.status, kNoneUsable);
    EXPECT_THAT(obstacle(without).at("what").get<std::string>(), HasSubstr("is not installed"));

    // As root; then the device in again, as it says.
    const ShellResult fixed = shell("forcegrid doctor --fix --seconds 0");
    EXPECT_THAT(fixed.text, HasSubstr(std::string("wrote ") + kRule));
    shell("udevadm control --reload");
    EXPECT_THAT(obstacle(ask("operator", "devices")).at("remedy").get<std::string>(),
                HasSubstr("plug the device in again"));
    bench.unplug(0);
    bench.plug_in("1-1");
    EXPECT_TRUE(eventually([] { return !nodes().empty(); }));
    shell("udevadm settle --timeout=20");
    EXPECT_EQ(ask("operator", "devices").status, 0);
  }
}

TEST(LongTools, DevicesNamesTheProcessThatDrivesTheDevice) {
  const Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  Program run = Program::forcegrid(run_arguments(
      "hid:1234:0006", 4.0, forcegrid::testing::fresh_folder("busy"), {"--calibrated"}));
  run.wait_for_line("Simulator: ");
  // By its lock, which any user sees.
  const Answer busy = ask("operator", "devices");
  EXPECT_EQ(busy.status, kNoneUsable);
  EXPECT_EQ(obstacle(busy).at("kind"), "busy");
  EXPECT_THAT(obstacle(busy).at("what").get<std::string>(), HasSubstr("(forcegrid) drives it"));
  EXPECT_EQ(run.wait(std::chrono::seconds(60)).value_or(-1), 0);
  EXPECT_EQ(ask("operator", "devices").status, 0);
}

}  // namespace
}  // namespace forcegrid::hil
