// SPDX-License-Identifier: Apache-2.0
// `forcegrid calibrate` as a person with a device at a real kernel would meet it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using forcegrid::testing::text_of;
using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr char kDevices[] = "/tmp/.config/forcegrid/devices";  // of "operator"
constexpr char kUnit[] = "/phantom_desktop@serial-PHANTOM-0001.toml";
constexpr char kShipped[] = "/usr/share/forcegrid/profiles/phantom_desktop.toml";
constexpr double kWatchdog_s = 0.5;
constexpr double kLate_s = 0.2;  // how late a thread of the emulator may run in the guest

// Homed already, nobody holds it, 30 g at the tip; what is said is for a script.
const std::vector<std::string> kArm = {"--calibrated", "--hand", "none", "--tip-mass", "0.03"};
const std::string kCalibrate =
    "calibrate --device hid:1209:0001 --profile phantom_desktop --calibrated --yes --let-go-s 0 ";

// What this unit was calibrated to before, of which not a byte may be lost.
std::string earlier_profile() {
  const std::string file = std::string(kDevices) + kUnit;
  fs::create_directories(kDevices);
  std::ofstream(file) << "# Calibrated by somebody, some time ago\n" << text_of(kShipped);
  EXPECT_EQ(shell("chown -R operator:operator /tmp/.config").status, 0);
  return file;
}

class LongCalibrate : public ::testing::Test {
 public:
  ~LongCalibrate() override { fs::remove_all("/tmp/.config"); }
};

void expect_motors_off(const json& emulator) {
  EXPECT_EQ(emulator.at("final_current_mA"), json({0.0, 0.0, 0.0})) << emulator;
}

TEST_F(LongCalibrate, AMemberMeasuresADeviceAndTheNextRunTakesWhatWasWritten) {
  Bench bench({"phantom_desktop"}, kArm);
  const std::string file = earlier_profile();
  const std::string earlier = text_of(file);
  const Answer found = ask("operator", kCalibrate + "--no-range --quick --tip-mass 0.03");
  ASSERT_EQ(found.status, 0) << found.result.dump(2);
  EXPECT_EQ(found.result.at("unit"), "serial-PHANTOM-0001");
  EXPECT_EQ(found.result.at("written"), file);
  EXPECT_EQ(found.result.at("zero_current_delivered"), true);
  EXPECT_EQ(text_of(file + ".old"), earlier);
  // The emulated arm is the profile's: what was measured must be what it says.
  for (const json& joint : found.result.at("joints")) {
    EXPECT_NEAR(joint.at("fit").at("scale").at("value").get<double>(), 1.0, 0.03) << joint;
  }
  const ShellResult run = as_user(
      "operator",
      "forcegrid run --device hid:1209:0001 --profile phantom_desktop --calibrated --scene " +
          tiny_scene() +
          " --device-timeout-ms 400 --no-reference --seconds 0.5 --out /tmp/out-calibrated");
  EXPECT_EQ(run.status, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("Calibrated profile of this unit: " + file));
  expect_motors_off(bench.end());
}

TEST_F(LongCalibrate, UnpluggedInTheMiddleOfAMotionTheMotorsGoOffAndTheOldProfileStays) {
  Bench bench({"phantom_desktop"}, kArm);
  const std::string file = earlier_profile();
  const std::string earlier = text_of(file);
  Program calibrate({"su", "operator", "-c", "forcegrid " + kCalibrate + "--no-range --quick"});
  ASSERT_TRUE(calibrate.wait_for_text("makes its strokes")) << calibrate.standard_error();
  std::this_thread::sleep_for(std::chrono::milliseconds(700));  // until it is on its way
  bench.unplug();
  const auto gone = Clock::now();
  EXPECT_EQ(calibrate.wait(std::chrono::seconds(20)).value_or(-1), 1);
  EXPECT_THAT(calibrate.standard_error(), HasSubstr("The device is gone"));
  EXPECT_THAT(calibrate.standard_error(), HasSubstr("plug it in again, and start again"));
  EXPECT_THAT(calibrate.standard_error(), Not(HasSubstr("terminate called")));
  EXPECT_EQ(text_of(file), earlier);
  EXPECT_EQ(std::distance(fs::directory_iterator(kDevices), fs::directory_iterator()), 1)
      << "something was left beside it";

  std::this_thread::sleep_for(std::chrono::seconds(1));  // longer than the device's watchdog takes
  const auto asked = Clock::now();
  const json emulator = bench.end();
  expect_motors_off(emulator);
  const auto peak_mA = emulator.at("max_abs_current_mA").get<std::vector<double>>();
  EXPECT_GT(*std::max_element(peak_mA.begin(), peak_mA.end()), 0.0) << "the motors never pushed";
  const double off_after_s = std::chrono::duration<double>(asked - gone).count() -
                             emulator.at("seconds_since_motors_nonzero").get<double>();
  EXPECT_LE(off_after_s, kWatchdog_s + kLate_s);
  measured("motors_off_after_unplug", off_after_s, "s");
}

// The shortest calibration: which way the motors push.
TEST_F(LongCalibrate, WithoutTheRuleItIsRefusedAndTheAdviceMendsIt) {
  const RuleTakenAway before_installation;
  {
    Bench bench({"phantom_desktop"}, kArm);
    const std::string look = "forcegrid " + kCalibrate + "--no-range --no-strokes";
    const ShellResult refused = as_user("operator", look);
    EXPECT_EQ(refused.status, 1) << refused.text;
    EXPECT_THAT(refused.text, HasSubstr("open " + bench.node().dev() + ": Permission denied"));
    EXPECT_THAT(refused.text, HasSubstr("install udev/10-forcegrid.rules"));
    EXPECT_THAT(refused.text, HasSubstr("plug the device in again"));
    EXPECT_FALSE(fs::exists(kDevices));

    // As it says; the rule comes from the program itself.
    EXPECT_THAT(shell("forcegrid doctor --fix --seconds 0").text,
                HasSubstr(std::string("wrote ") + kRule));
    EXPECT_EQ(shell("udevadm control --reload").status, 0);
    bench.unplug();
    bench.plug_in("1-1");
    EXPECT_TRUE(eventually([] { return !nodes().empty(); }));
    shell("udevadm settle --timeout=20");
    std::this_thread::sleep_for(std::chrono::milliseconds(1100));  // until the firmware is up
    const ShellResult taken = as_user("operator", look);
    EXPECT_EQ(taken.status, 0) << taken.text;
    EXPECT_THAT(taken.text, HasSubstr("ok      direction of joint c"));
    const ShellResult other = as_user("visitor", look);
    EXPECT_EQ(other.status, 1) << other.text;
    expect_motors_off(bench.end());
  }
}

}  // namespace
}  // namespace forcegrid::hil
