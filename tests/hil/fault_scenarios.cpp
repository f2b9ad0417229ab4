// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kWatchdog_s = 0.5;
// The command that was under way, a frame of the bus and the watchdog's own check.
constexpr double kSlack_s = 0.05;
// A zero goes out 40 ms after a report that has not come.
constexpr double kFirstKick_s = 0.04 + kSlack_s;
constexpr double kUntilWatchdog_s = kWatchdog_s + kSlack_s;

/// The tool is at the object from 1.7 s on; after half a second of force the fault begins.
FaultyRun run_with(const std::string& fault, double run_s = 5.0, const char* motion = "chirp") {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated", "--motion", motion, "--fault", fault});
  FaultyRun result{run("hid:1234:0006", run_s, {"--calibrated"}), {}};
  std::this_thread::sleep_for(seconds(1));  // longer than the device's watchdog takes
  result.emulator = bench.end();
  expect_orderly_end(result);
  return result;
}

// --- reports ---

TEST(LongFault, DroppedReportsAreCountedAndKickedFor) {
  const FaultyRun result = run_with("drop-report:every=100");
  expect_endured(result);
  EXPECT_GT(number(result.felt.summary, "reports_lost"), 0);
  EXPECT_GT(number(result.felt.summary, "kicks"), 0);
}

TEST(LongFault, DuplicatedReportsAreDrained) {
  const FaultyRun result = run_with("duplicate-report:every=20");
  expect_endured(result);
  // One that is taken for the answer to the next OUT brings the OUT after that forward, and the
  // device skips one of the two: then nothing is left over here.
  EXPECT_GT(
      number(result.felt.summary, "reports_drained") + number(result.emulator, "reports_drained"),
      0);
}

TEST(LongFault, ReportsLateBy5msAreEndured) { expect_endured(run_with("late-report:ms=5")); }

TEST(LongFault, ReportsLateBy50msEndTheRun) {
  expect_motors_off(run_with("late-report:ms=50"), {"late_reports"}, 2.0);
}

TEST(LongFault, ReportsLateBy500msEndTheRun) {
  // The scenarios' --device-timeout-ms 400, and what was under way.
  expect_motors_off(run_with("late-report:ms=500"), {"stale_reports"}, 0.6);
}

// A kernel may throw away what is shorter than the descriptor's report, and say so: then the device
// is silent for whoever reads its node. Others hand it up.
TEST(LongFault, ShortReportsEndTheRun) {
  const FaultyRun result = run_with("short-report");
  expect_motors_off(result, {"stale_reports", "protocol"}, kFirstKick_s);
  ASSERT_TRUE(result.felt.summary.is_object());
  const auto& fault = result.felt.summary.at("faults").at(0);
  EXPECT_EQ(fault.at("name") == "stale_reports",
            shell("dmesg").text.find("was too short") != std::string::npos)
      << fault;
}

TEST(LongFault, LongReportsEndTheRun) {
  // usbhid offers room for the descriptor's report: more may be babble, and never come up here.
  expect_motors_off(run_with("long-report"), {"protocol", "stale_reports", "late_reports"}, 0.6);
}

TEST(LongFault, CorruptReportsEndTheRun) {
  expect_zero_sent(run_with("corrupt-report:size=large"),
                   {"implausible_jump", "too_fast", "bad_pose"}, 0.1);
}

TEST(LongFault, ASmallCorruptionIsEndured) {
  expect_endured(run_with("corrupt-report:size=small"));
}

// --- encoders ---

// The hand pulls at the object with some 2.5 N by then, and only trembles: far above the torque
// that friction could hide. A joint is watched for 0.16 s, and a suspicion that came just before
// may have left it alone for a second.
TEST(LongFault, FrozenEncodersEndTheRun) {
  constexpr double kSuspicion_s = 0.16;
  constexpr double kPatience_s = 1.0;
  expect_zero_sent(run_with("frozen-encoder:axis=all,when=7", 10.0, "hold"), {"frozen_encoder"},
                   kPatience_s + kSuspicion_s + kSlack_s);
}

TEST(LongFault, AJumpingEncoderEndsTheRun) {
  expect_zero_sent(run_with("jumping-encoder"), {"implausible_jump"}, 0.15);
}

TEST(LongFault, AWrapOf16BitsIsNormal) {
  expect_endured(run_with("wrapping-encoder:axis=c,bits=16"));
}

TEST(LongFault, ASaturatedEncoderEndsTheRun) {
  expect_zero_sent(run_with("saturated-encoder"), {"saturated_encoder"}, 0.1);
}

// --- endpoints ---

// usbhid clears the halt, asks again, and meets the next STALL: no report comes, and a firmware
// whose report is not collected looks at no command.
TEST(LongFault, AStallOnInLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("stall-in"), {"stale_reports"}, kUntilWatchdog_s);
}

// usbhid gives up and asks for a reset of the device: commands don't reach it either.
TEST(LongFault, BabbleLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("babble"), {"stale_reports"}, kUntilWatchdog_s);
}

TEST(LongFault, AStallOnOutLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("stall-out"), {"protocol"}, kUntilWatchdog_s);
}

// The kernel's USB/IP client trusts nothing that comes after such an answer, and drops the device.
TEST(LongFault, AnOverLongPayloadLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("over-long-payload"), {"unplugged"}, kUntilWatchdog_s);
}

// The kernel may hold whoever writes to a hidraw node for 5 s.
TEST(LongFault, NakForEverOnOutLeavesTheMotorsToTheWatchdogAndHoldsNobodyUp) {
  const auto begun = std::chrono::steady_clock::now();
  expect_watchdog(run_with("nak-out"), {"stale_reports"}, kUntilWatchdog_s);
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  measured("run_and_end", took_s, "s");
  EXPECT_LT(took_s, 30.0);
}

TEST(LongFault, AStallOnControlLeavesNoDeviceToOpen) {
  covers_device("woodenhaptics_v2015");
  covers_host("kernel");
  covers_host("forcegrid-hidraw");
  expect_refused_with_stalled_control(
      "woodenhaptics_v2015", [] { return run("hid:1234:0006", 1.0, {"--calibrated"}); },
      "not found");
}

// --- firmware and motors ---

TEST(LongFault, FirmwareSlowBy5msIsEnduredAndCounted) {
  const FaultyRun result = run_with("slow-firmware:ms=5");
  expect_endured(result);
  EXPECT_GT(number(result.felt.summary, "reports_late"), 0);
}

TEST(LongFault, FirmwareThatIsTooSlowEndsTheRun) {
  expect_motors_off(run_with("slow-firmware:ms=50"), {"late_reports", "stale_reports"}, 2.0);
}

// W2's reports do not tell of it. The loop goes on without force, unless a loaded joint that
// happens to stand still gives it away.
TEST(LongFault, AWatchdogThatTripsTakesTheCurrentAway) {
  const FaultyRun result = run_with("watchdog-trip");
  ASSERT_TRUE(result.felt.summary.is_object());
  if (result.felt.status != 0) {
    expect_named(result, {"frozen_encoder"});
  }
  EXPECT_GT(largest_command(result.emulator), 0.0) << "the motors never pushed";
  EXPECT_GE(number(result.emulator, "watchdog_trips"), 1);
  EXPECT_LE(seconds_until_motors_off(result), kUntilWatchdog_s);
}

TEST(LongFault, ARebootOfTheFirmwareTakesThePowerAndEndsTheRun) {
  expect_watchdog(run_with("firmware-reboot"), {"unplugged"}, kSlack_s);
}

TEST(LongFault, AConnectionThatClosesEndsTheRun) {
  expect_watchdog(run_with("connection-closed"), {"unplugged"}, kUntilWatchdog_s);
}

TEST(LongFault, AMotorThatPushesTheWrongWayIsFoundBeforeAnyForce) {
  expect_wrong_way_motor(run_with("wrong-way-motor:axis=b"));
}

// --- out and in again ---

void expect_reconnected_and_calibrated(const nlohmann::json& summary) {
  EXPECT_TRUE(summary.at("faults").empty()) << summary.at("faults");
  EXPECT_EQ(summary.at("reconnects"), 1);
  EXPECT_EQ(summary.at("recalibrations"), 1);
  ASSERT_EQ(summary.at("recovered_faults").size(), 1U);
  EXPECT_EQ(summary.at("recovered_faults")[0].at("name"), "unplugged");
  EXPECT_TRUE(summary.at("zero_current_delivered").get<bool>());
}

// The cable is pulled in mid-force and plugged in again; who holds the arm lets go of it meanwhile,
// so that counters which nobody has confirmed would not be believed.
TEST(LongReplug, TheLoopWaitsIsCalibratedRampsInAndGoesOnWhenAskedTo) {
  covers_host("forcegrid-hidraw");
  Bench bench({"woodenhaptics_v2015"}, {"--motion", "hold"});
  const std::string folder = forcegrid::testing::fresh_folder("replug");
  Program program =
      Program::forcegrid(run_arguments("hid:1234:0006", 12.0, folder, {"--reconnect"}));
  program.wait_for_line("Simulator: ");
  std::this_thread::sleep_for(milliseconds(3500));
  bench.unplug();
  EXPECT_TRUE(program.wait_for_text("Waiting for the device"));
  std::this_thread::sleep_for(seconds(1));
  bench.plug_in();
  EXPECT_TRUE(program.wait_for_text("The device is back and calibrated"));
  EXPECT_EQ(program.wait(seconds(60)).value_or(-1), 0)
      << program.standard_output() << program.standard_error();
  std::ifstream file(folder + "/summary.json");
  const auto summary = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(summary.is_object());
  expect_reconnected_and_calibrated(summary);
  const auto emulator = bench.end();
  EXPECT_EQ(final_command(emulator), kMotorsOff);
  EXPECT_GE(number(emulator, "watchdog_trips"), 1) << "while the cable was out";
  // The operator lets go for a while and comes back to the object: the motors have pushed again.
  EXPECT_LT(emulator.at("seconds_since_motors_nonzero").get<double>(), 4.0);
}

/// A board that reboots in mid-force, and a run that waits for it. @returns both, when the run has
/// ended by itself; the program's own words in `felt.text`.
FaultyRun run_through_a_reboot(const std::vector<std::string>& emulator_arguments,
                               const std::vector<std::string>& run_options, double run_s) {
  covers_host("forcegrid-hidraw");
  std::vector<std::string> arguments = emulator_arguments;
  arguments.insert(arguments.end(), {"--motion", "hold", "--fault", "firmware-reboot:ms=1000"});
  Bench bench({"woodenhaptics_v2015"}, arguments);
  FaultyRun result;
  result.felt.folder = forcegrid::testing::fresh_folder("reboot");
  Program program =
      Program::forcegrid(run_arguments("hid:1234:0006", run_s, result.felt.folder, run_options));
  EXPECT_TRUE(program.wait_for_text("Waiting for the device"));
  std::this_thread::sleep_for(milliseconds(1500));
  bench.plug_in();
  result.felt.status = program.wait(seconds(60)).value_or(-1);
  result.felt.text = program.standard_output() + program.standard_error();
  std::ifstream file(result.felt.folder + "/summary.json");
  result.felt.summary = nlohmann::json::parse(file, nullptr, false);
  result.emulator = bench.end();
  EXPECT_TRUE(result.felt.summary.is_object()) << result.felt.text;
  EXPECT_EQ(final_command(result.emulator), kMotorsOff) << result.felt.text;
  return result;
}

TEST(LongReplug, ADeviceThatLostItsPowerIsCalibratedAgain) {
  const FaultyRun result = run_through_a_reboot({}, {"--reconnect"}, 12.0);
  EXPECT_EQ(result.felt.status, 0) << result.felt.text;
  const auto& summary = result.felt.summary;
  ASSERT_TRUE(summary.is_object());
  expect_reconnected_and_calibrated(summary);
  EXPECT_EQ(number(result.emulator, "counters_loaded"), 2);
  EXPECT_LT(result.emulator.at("seconds_since_motors_nonzero").get<double>(), 4.0)
      << "the motors have not pushed again";
}

// Nobody can calibrate it there, and its counters are not believed: they have counted from zero
// what the hand has moved since.
TEST(LongReplug, ADeviceThatLostItsPowerIsRefusedWhereNobodyCanCalibrate) {
  const FaultyRun result =
      run_through_a_reboot({"--calibrated"}, {"--calibrated", "--reconnect"}, 20.0);
  EXPECT_EQ(result.felt.status, 1) << result.felt.text;
  EXPECT_THAT(result.felt.text,
              AllOf(HasSubstr("the device was not reconnected: its encoder counters "),
                    HasSubstr("it has lost power")));
  ASSERT_TRUE(result.felt.summary.is_object());
  EXPECT_EQ(result.felt.summary.at("reconnects"), 0);
  EXPECT_GT(result.emulator.at("seconds_since_motors_nonzero").get<double>(), 1.0)
      << "the motors have pushed again";
}

}  // namespace
}  // namespace forcegrid::hil
