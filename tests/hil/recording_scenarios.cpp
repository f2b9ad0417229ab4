// SPDX-License-Identifier: Apache-2.0
// `forcegrid record`, `replay`, `run --live` and the configuration file with a device at a real
// kernel, by the people who use it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"
#include "tests/support/in_terminal.h"

namespace forcegrid::hil {
namespace {

using forcegrid::testing::fresh_folder;
using forcegrid::testing::InTerminal;
using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::seconds;

// A homed arm whose hand stays in the object: 1.7 s after the first command it is there.
const std::vector<std::string> kArm = {"--calibrated", "--motion", "hold"};
constexpr milliseconds kInMidForce{4500};
constexpr double kWatchdog_s = 0.5;
constexpr double kLate_s = 0.2;  // how late a thread of the emulator may run in the guest

// A folder in which "operator" may write.
std::string operators_folder(const std::string& name) {
  const std::string folder = fresh_folder(name);
  EXPECT_EQ(shell("chown operator:operator " + folder).status, 0);
  return folder;
}

// What follows `forcegrid record FILE` or `forcegrid run`.
std::string felt_for(double time_s, const std::string& folder) {
  return " --device hid:1234:0006 --calibrated --scene " + tiny_scene() +
         " --no-reference --device-timeout-ms 400 --seconds " + std::to_string(time_s) + " --out " +
         folder;
}

/// What `forcegrid plot` finds in a recording.
json found_in(const std::string& file, const std::string& folder) {
  return ask("operator", "plot " + file + " --out " + folder).result;
}

void expect_motors_off(const json& emulator) {
  EXPECT_EQ(emulator.at("final_current_mA"), json({0.0, 0.0, 0.0})) << emulator;
}

/// The motors pushed until `gone`, and the watchdog ended that.
void expect_stopped_by_the_watchdog(Bench& bench, std::chrono::steady_clock::time_point gone) {
  std::this_thread::sleep_for(seconds(3));
  const auto asked = std::chrono::steady_clock::now();
  const json emulator = bench.end();
  expect_motors_off(emulator);
  EXPECT_GE(emulator.at("watchdog_trips").get<int>(), 1);
  ASSERT_TRUE(emulator.at("seconds_since_motors_nonzero").is_number()) << emulator;
  const double off_after_s = std::chrono::duration<double>(asked - gone).count() -
                             emulator.at("seconds_since_motors_nonzero").get<double>();
  EXPECT_GT(off_after_s, 0.0) << "the motors had no current at the end";
  EXPECT_LE(off_after_s, kWatchdog_s + kLate_s);
  measured("motors_off_after_the_end", off_after_s, "s");
}

TEST(LongRecord, AMemberRecordsEveryCycleAndAnybodyReplaysItWithoutTheDevice) {
  const std::string folder = operators_folder("record");
  const std::string file = folder + "/run.h5";
  {
    Bench bench({"woodenhaptics_v2015"}, kArm);
    const ShellResult refused =
        as_user("visitor", "forcegrid record /tmp/visitor.h5" + felt_for(1.0, "/tmp/out-visitor"));
    EXPECT_EQ(refused.status, 1) << refused.text;
    EXPECT_THAT(refused.text, HasSubstr("open " + bench.node().dev() + ": Permission denied"));
    EXPECT_FALSE(fs::exists("/tmp/visitor.h5")) << "an empty recording was left";

    const Answer recorded = ask("operator", "record " + file + felt_for(4.0, folder));
    ASSERT_EQ(recorded.status, 0) << recorded.result.dump(2);
    EXPECT_EQ(recorded.result.at("records_lost"), 0);
    const json found = found_in(file, folder);
    EXPECT_EQ(found.at("cycles"), recorded.result.at("cycles"));
    EXPECT_EQ(found.at("complete"), true);
    expect_motors_off(bench.end());
  }
  EXPECT_EQ(shell("chmod 755 " + folder).status, 0);
  const ShellResult replayed = as_user(
      "visitor", "forcegrid replay " + file + " --method hold --seconds 1 --out /tmp/again");
  EXPECT_EQ(replayed.status, 0) << replayed.text;
  EXPECT_THAT(replayed.text, HasSubstr("/tmp/again/replay.h5"));
}

TEST(LongRecord, WhereNothingCanBeWrittenIsSaidBeforeAMotorMoves) {
  Bench bench({"woodenhaptics_v2015"}, kArm);
  const std::string folder = fresh_folder("roots");
  EXPECT_EQ(shell("chmod 755 " + folder).status, 0);
  const ShellResult refused = as_user(
      "operator", "forcegrid record " + folder + "/run.h5" + felt_for(1.0, "/tmp/out-refused"));
  EXPECT_EQ(refused.status, 1) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr(folder + "/run.h5"));
  EXPECT_THAT(refused.text, HasSubstr("Permission denied"));
  const json emulator = bench.end();
  expect_motors_off(emulator);
  EXPECT_EQ(emulator.at("max_abs_current_mA"), json({0.0, 0.0, 0.0})) << emulator;
}

TEST(LongRecord, AfterTheCableWasPulledTheFileIsCompleteUpToTheFault) {
  Bench bench({"woodenhaptics_v2015"}, kArm);
  const std::string folder = operators_folder("record_unplugged");
  const std::string file = folder + "/run.h5";
  Program record({"su", "operator", "-c", "forcegrid record " + file + felt_for(60.0, folder)});
  EXPECT_NE(record.wait_for_line("Simulator: "), "") << record.standard_error();
  std::this_thread::sleep_for(kInMidForce);
  bench.unplug();
  const auto gone = std::chrono::steady_clock::now();
  EXPECT_EQ(record.wait(seconds(20)).value_or(-1), 1);
  const std::string text = record.standard_output() + record.standard_error();
  EXPECT_THAT(text, HasSubstr("FAULT: The device is gone"));
  const json found = found_in(file, folder);
  EXPECT_EQ(found.at("complete"), true);
  EXPECT_GT(found.at("cycles").get<int>(), 1000);
  expect_stopped_by_the_watchdog(bench, gone);
}

TEST(LongRecord, KilledItLeavesAReadableFileAndTheDeviceStopsItsMotors) {
  Bench bench({"woodenhaptics_v2015"}, kArm);
  const std::string folder = operators_folder("record_killed");
  const std::string file = folder + "/run.h5";
  Program record(
      {"su", "operator", "-c", "exec forcegrid record " + file + felt_for(60.0, folder)});
  EXPECT_NE(record.wait_for_line("Simulator: "), "") << record.standard_error();
  std::this_thread::sleep_for(kInMidForce);
  record.send_signal(SIGKILL);
  const auto gone = std::chrono::steady_clock::now();
  record.wait(seconds(20));
  const json found = found_in(file, folder);
  EXPECT_EQ(found.at("complete"), false);
  EXPECT_GT(found.at("cycles").get<int>(), 500);
  expect_stopped_by_the_watchdog(bench, gone);
}

TEST(LongRecord, ADiskThatFillsUpEndsTheRecordingAndNotTheLoop) {
  Bench bench({"woodenhaptics_v2015"}, kArm);
  const std::string folder = operators_folder("small_disk");
  ASSERT_EQ(shell("mount -t tmpfs -o size=72m,mode=777 tmpfs " + folder).status, 0);
  const std::string file = folder + "/run.h5";
  Program record({"su", "operator", "-c", "forcegrid record " + file + felt_for(8.0, "/tmp/felt")});
  EXPECT_NE(record.wait_for_line("Simulator: "), "") << record.standard_error();
  std::this_thread::sleep_for(seconds(3));
  // 64 MB are left alone.
  EXPECT_EQ(shell("dd if=/dev/zero of=" + folder + "/other bs=1M count=10").status, 0);
  EXPECT_EQ(record.wait(seconds(40)).value_or(-1), 1);
  const std::string text = record.standard_output() + record.standard_error();
  EXPECT_THAT(text, HasSubstr("less than 64 MB are free on the disk of " + file));
  EXPECT_THAT(text, Not(HasSubstr("FAULT")));
  const json found = found_in(file, "/tmp/found");
  EXPECT_GT(found.at("cycles").get<int>(), 500);
  EXPECT_LT(found.at("cycles").get<int>(), 4000) << "nothing was lost";
  expect_motors_off(bench.end());
  EXPECT_EQ(shell("umount " + folder).status, 0);
}

TEST(LongLive, WhenTheCableIsPulledTheTerminalIsGivenBackAndTheFaultStandsBelow) {
  if (!fs::exists("/dev/pts/ptmx")) {
    ASSERT_EQ(shell("mkdir -p /dev/pts && mount -t devpts devpts /dev/pts").status, 0);
  }
  Bench bench({"woodenhaptics_v2015"}, kArm);
  InTerminal live(
      {"su", "operator", "-c", "forcegrid run --live" + felt_for(60.0, "/tmp/felt-live")});
  ASSERT_TRUE(live.wait_for("of 500 cycles/s")) << live.seen();
  ASSERT_TRUE(live.wait_for("Samples come; the force ramps in.")) << live.seen();
  bench.unplug();
  EXPECT_TRUE(live.gave_the_terminal_back()) << live.seen();
  EXPECT_THAT(live.seen_afterwards(), HasSubstr("FAULT: The device is gone"));
  EXPECT_EQ(live.wait(), 1);
  expect_motors_off(bench.end());
}

// The administrator names the device by its lasting link, a person chooses the rate.
TEST(LongConfig, TheSystemsFileAndAPersonsOwnAreTakenTogetherAndMistakesStopBeforeTheDevice) {
  Bench bench({"woodenhaptics_v2015"}, kArm);
  const std::string link = fs::directory_iterator("/dev/forcegrid")->path().string();
  fs::create_directories("/etc/forcegrid");
  std::ofstream("/etc/forcegrid/config.toml")
      << "[run]\ndevice = \"hid:" << link << "\"\ncalibrated = true\nrate = 500\n";
  fs::create_directories("/tmp/.config/forcegrid");
  std::ofstream("/tmp/.config/forcegrid/config.toml") << "[run]\nrate = 250\n";
  const std::string run =
      "run --scene " + tiny_scene() +
      " --no-reference --device-timeout-ms 400 --seconds 1 --out /tmp/configured";
  const Answer felt = ask("operator", run);
  EXPECT_EQ(felt.status, 0) << felt.result.dump(2);
  EXPECT_EQ(felt.result.at("servo_rate_requested_Hz"), 250);
  EXPECT_EQ(felt.result.at("device"), "hid:" + link);

  EXPECT_EQ(shell("chmod 600 /etc/forcegrid/config.toml").status, 0);
  const ShellResult unreadable = as_user("operator", "forcegrid " + run);
  EXPECT_EQ(unreadable.status, 2) << unreadable.text;
  EXPECT_THAT(unreadable.text, HasSubstr("/etc/forcegrid/config.toml"));
  EXPECT_THAT(unreadable.text, HasSubstr("make the file readable"));

  EXPECT_EQ(shell("chmod 644 /etc/forcegrid/config.toml").status, 0);
  std::ofstream("/tmp/.config/forcegrid/config.toml") << "[run]\nraet = 250\n";
  const ShellResult mistyped = as_user("operator", "forcegrid " + run);
  EXPECT_EQ(mistyped.status, 2) << mistyped.text;
  EXPECT_THAT(mistyped.text, HasSubstr("raet"));
  EXPECT_THAT(mistyped.text, HasSubstr("rate"));
  const json emulator = bench.end();
  expect_motors_off(emulator);
  fs::remove_all("/tmp/.config");
  fs::remove_all("/etc/forcegrid");
}

}  // namespace
}  // namespace forcegrid::hil
