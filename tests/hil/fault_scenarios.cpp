#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kWatchdog_s = 0.5;
// The command that was under way, a frame of the bus and the watchdog's own check.
constexpr double kSlack_s = 0.05;

std::int64_t number(const nlohmann::json& json, const char* key) {
  return json.at(key).get<std::int64_t>();
}

double largest_mA(const nlohmann::json& emulator) {
  const auto peak_mA = emulator.at("max_abs_current_mA").get<std::vector<double>>();
  return *std::max_element(peak_mA.begin(), peak_mA.end());
}

const nlohmann::json kNoCurrent = {0.0, 0.0, 0.0};

/// A loop that has run against a device with a fault, and what the device says of it.
struct FaultyRun {
  EndedRun felt;
  nlohmann::json emulator;
};

/// The tool is at the object from 1.7 s on; after half a second of force the fault begins.
FaultyRun run_with(const std::string& fault, double run_s = 5.0) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated", "--fault", fault});
  FaultyRun result{run("hid:1234:0006", run_s, {"--calibrated"}), {}};
  std::this_thread::sleep_for(seconds(1));  // longer than the device's watchdog takes
  result.emulator = bench.end();
  EXPECT_EQ(result.emulator.at("final_current_mA"), kNoCurrent) << result.felt.text;
  EXPECT_TRUE(result.felt.summary.is_object()) << result.felt.text;
  EXPECT_THAT(result.felt.text, Not(HasSubstr("terminate called")));
  return result;
}

/// The loop ends by itself with one FAULT sentence under one of these names.
void expect_named(const FaultyRun& result, const std::vector<std::string>& names) {
  const EndedRun& felt = result.felt;
  ASSERT_TRUE(felt.summary.is_object());
  EXPECT_EQ(felt.status, 1) << felt.text;
  EXPECT_EQ(felt.text.find("FAULT"), felt.text.rfind("FAULT")) << felt.text;
  ASSERT_EQ(felt.summary.at("faults").size(), 1U) << felt.text;
  EXPECT_THAT(names, Contains(felt.summary.at("faults")[0].at("name").get<std::string>()))
      << felt.text;
  EXPECT_THAT(felt.text, HasSubstr(felt.summary.at("faults")[0].at("sentence")));
}

double seconds_until_motors_off(const FaultyRun& result) {
  const auto& faults = result.emulator.at("faults");
  EXPECT_EQ(faults.size(), 1U) << result.emulator;
  if (faults.empty() || !faults[0].at("seconds_until_motors_off").is_number()) {
    ADD_FAILURE() << "the fault never acted, or the motors never stopped: " << result.emulator;
    return 1e9;
  }
  const double taken_s = faults[0].at("seconds_until_motors_off").get<double>();
  measured("motors_off_after_fault", taken_s, "s");
  return taken_s;
}

/// The run ends by itself and the motors are off within `within_s` of the fault's first act. When
/// the last zero can't be known to have been taken, the program says who stops the motors.
void expect_motors_off(const std::string& fault, const std::vector<std::string>& names,
                       double within_s, double run_s = 5.0) {
  const FaultyRun result = run_with(fault, run_s);
  expect_named(result, names);
  if (!result.felt.summary.at("zero_current_delivered").get<bool>()) {
    EXPECT_THAT(result.felt.text, HasSubstr("watchdog"));
  }
  EXPECT_GT(largest_mA(result.emulator), 0.0) << "the motors never pushed";
  EXPECT_LE(seconds_until_motors_off(result), within_s) << result.felt.text;
}

/// Commands still reach the device, and the program knows that the last zero did.
void expect_zero_sent(const std::string& fault, const std::vector<std::string>& names,
                      double within_s, double run_s = 5.0) {
  const FaultyRun result = run_with(fault, run_s);
  expect_named(result, names);
  EXPECT_TRUE(result.felt.summary.at("zero_current_delivered").get<bool>()) << result.felt.text;
  EXPECT_GT(largest_mA(result.emulator), 0.0) << "the motors never pushed";
  EXPECT_LE(seconds_until_motors_off(result), within_s) << result.felt.text;
}

/// Nothing reaches the device any more: its own watchdog stops the motors, and the program does not
/// claim what it can't know.
void expect_watchdog(const std::string& fault, const std::vector<std::string>& names) {
  const FaultyRun result = run_with(fault);
  expect_named(result, names);
  EXPECT_FALSE(result.felt.summary.at("zero_current_delivered").get<bool>()) << result.felt.text;
  EXPECT_GT(largest_mA(result.emulator), 0.0) << "the motors never pushed";
  EXPECT_LE(seconds_until_motors_off(result), kWatchdog_s + kSlack_s) << result.felt.text;
  EXPECT_THAT(result.felt.text, HasSubstr("watchdog"));
}

/// The loop goes on and counts. @returns its summary.
FaultyRun expect_endured(const std::string& fault) {
  FaultyRun result = run_with(fault);
  EXPECT_EQ(result.felt.status, 0) << result.felt.text;
  if (result.felt.summary.is_object()) {
    EXPECT_TRUE(result.felt.summary.at("faults").empty()) << result.felt.text;
    EXPECT_TRUE(result.felt.summary.at("zero_current_delivered").get<bool>());
  }
  EXPECT_GT(largest_mA(result.emulator), 0.0) << "the motors never pushed";
  return result;
}

// --- reports ---

TEST(LongFault, DroppedReportsAreCountedAndKickedFor) {
  const FaultyRun result = expect_endured("drop-report:every=100");
  EXPECT_GT(number(result.felt.summary, "reports_lost"), 0);
  EXPECT_GT(number(result.felt.summary, "kicks"), 0);
}

TEST(LongFault, DuplicatedReportsAreDrained) {
  const FaultyRun result = expect_endured("duplicate-report:every=20");
  EXPECT_GT(number(result.felt.summary, "reports_drained"), 0);
}

TEST(LongFault, ReportsLateBy5msAreEndured) { expect_endured("late-report:ms=5"); }

TEST(LongFault, ReportsLateBy50msEndTheRun) {
  expect_motors_off("late-report:ms=50", {"late_reports"}, 2.0);
}

TEST(LongFault, ReportsLateBy500msEndTheRun) {
  // The scenarios' --device-timeout-ms 400, and what was under way.
  expect_motors_off("late-report:ms=500", {"stale_reports"}, 0.6);
}

TEST(LongFault, LongReportsEndTheRun) {
  // usbhid offers room for the descriptor's report: more may be babble, and never come up here.
  expect_motors_off("long-report", {"protocol", "stale_reports", "late_reports"}, 0.6);
}

TEST(Fault, CorruptReportsEndTheRun) {
  expect_zero_sent("corrupt-report:size=large", {"implausible_jump", "too_fast", "bad_pose"}, 0.1);
}

TEST(LongFault, ASmallCorruptionIsEndured) { expect_endured("corrupt-report:size=small"); }

// --- encoders ---

TEST(LongFault, AJumpingEncoderEndsTheRun) {
  expect_zero_sent("jumping-encoder", {"implausible_jump"}, 0.15);
}

TEST(LongFault, AWrapOf16BitsIsNormal) { expect_endured("wrapping-encoder:axis=c,bits=16"); }

TEST(LongFault, ASaturatedEncoderEndsTheRun) {
  expect_zero_sent("saturated-encoder", {"saturated_encoder"}, 0.1);
}

// --- endpoints ---

// usbhid gives up and asks for a reset of the device: commands don't reach it either.
TEST(LongFault, BabbleLeavesTheMotorsToTheWatchdog) {
  expect_watchdog("babble", {"stale_reports"});
}

TEST(LongFault, AStallOnOutLeavesTheMotorsToTheWatchdog) {
  expect_watchdog("stall-out", {"protocol"});
}

// The kernel may hold whoever writes to a hidraw node for 5 s.
TEST(LongFault, NakForEverOnOutLeavesTheMotorsToTheWatchdogAndHoldsNobodyUp) {
  const auto begun = std::chrono::steady_clock::now();
  expect_watchdog("nak-out", {"stale_reports"});
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  measured("run_and_end", took_s, "s");
  EXPECT_LT(took_s, 30.0);
}

TEST(LongFault, AStallOnControlLeavesNoDeviceToOpen) {
  covers_device("woodenhaptics_v2015");
  covers_host("kernel");
  covers_host("forcegrid-hidraw");
  const std::string report_file = forcegrid::testing::fresh_folder("stalled") + "/report.json";
  Program emulator =
      Program::forcegrid({"emulate", "--device", "woodenhaptics_v2015", "--listen",
                          "127.0.0.1:3240", "--fault", "stall-control", "--json", report_file});
  ASSERT_TRUE(emulator.wait_for_text("busid 1-1"));
  shell("usbip attach -r 127.0.0.1 -b 1-1");
  std::this_thread::sleep_for(seconds(5));
  const EndedRun refused = run("hid:1234:0006", 1.0, {"--calibrated"});
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, HasSubstr("not found"));
  shell("usbip detach -p 0");
  emulator.send_signal(SIGTERM);
  EXPECT_EQ(emulator.wait(seconds(20)).value_or(-1), 0) << emulator.standard_error();
  std::ifstream file(report_file);
  const auto report = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(report.is_object());
  EXPECT_EQ(report.at("max_abs_current_mA"), kNoCurrent);
}

// --- firmware and motors ---

TEST(LongFault, FirmwareThatIsTooSlowEndsTheRun) {
  expect_motors_off("slow-firmware:ms=50", {"late_reports", "stale_reports"}, 2.0);
}

TEST(LongFault, AConnectionThatClosesEndsTheRun) {
  expect_watchdog("connection-closed", {"unplugged"});
}

TEST(LongFault, AMotorThatPushesTheWrongWayIsFoundBeforeAnyForce) {
  const FaultyRun result = run_with("wrong-way-motor:axis=b");
  expect_named(result, {"motor_wrong_way"});
  EXPECT_THAT(result.felt.text, HasSubstr("The motor of joint b pushes the wrong way"));
  EXPECT_TRUE(result.felt.summary.at("zero_current_delivered").get<bool>());
}

// --- out and in again ---

/// A run that waits for its device: the cable is pulled in mid-force and plugged in again.
TEST(LongReplug, TheLoopWaitsRampsInAndGoesOnWhenAskedTo) {
  covers_host("forcegrid-hidraw");
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated", "--motion", "hold"});
  const std::string folder = forcegrid::testing::fresh_folder("replug");
  Program program = Program::forcegrid(
      run_arguments("hid:1234:0006", 11.0, folder, {"--calibrated", "--reconnect"}));
  program.wait_for_line("Simulator: ");
  std::this_thread::sleep_for(milliseconds(3000));
  bench.unplug();
  EXPECT_TRUE(program.wait_for_text("Waiting for the device"));
  std::this_thread::sleep_for(seconds(1));
  bench.plug_in();
  EXPECT_TRUE(program.wait_for_text("The device is back"));
  EXPECT_EQ(program.wait(seconds(60)).value_or(-1), 0)
      << program.standard_output() << program.standard_error();
  std::ifstream file(folder + "/summary.json");
  const auto summary = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(summary.is_object());
  EXPECT_TRUE(summary.at("faults").empty()) << summary.at("faults");
  EXPECT_EQ(summary.at("reconnects"), 1);
  EXPECT_EQ(summary.at("recovered_faults")[0].at("name"), "unplugged");
  EXPECT_TRUE(summary.at("zero_current_delivered").get<bool>());
  const auto emulator = bench.end();
  EXPECT_EQ(emulator.at("final_current_mA"), kNoCurrent);
  EXPECT_GE(number(emulator, "watchdog_trips"), 1) << "while the cable was out";
  // The operator lets go for a while and comes back to the object: the motors have pushed again.
  EXPECT_LT(emulator.at("seconds_since_motors_nonzero").get<double>(), 4.0);
}

}  // namespace
}  // namespace forcegrid::hil
