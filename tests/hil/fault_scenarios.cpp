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
FaultyRun run_with(const std::string& fault, const std::vector<std::string>& arguments = {}) {
  constexpr double kSeconds = 5.0;
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated", "--fault", fault});
  std::vector<std::string> all = {"--calibrated"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  FaultyRun result{run("hid:1234:0006", kSeconds, all), {}};
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

/// Commands still reach the device: it gets zero, within `within_s` of the fault's first act.
void expect_zero_sent(const std::string& fault, const std::vector<std::string>& names,
                      double within_s) {
  const FaultyRun result = run_with(fault);
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
  if (names != std::vector<std::string>{"unplugged"}) {
    EXPECT_THAT(result.felt.text, HasSubstr("watchdog"));
  }
}

// --- reports ---

TEST(LongFault, CorruptReportsEndTheRun) {
  expect_zero_sent("corrupt-report:size=large", {"implausible_jump", "too_fast", "bad_pose"}, 0.1);
}

// --- endpoints ---

// usbhid gives up and asks for a reset of the device: commands don't reach it either.
TEST(LongFault, BabbleLeavesTheMotorsToTheWatchdog) {
  expect_watchdog("babble", {"stale_reports"});
}

// The kernel may hold whoever writes to a hidraw node for 5 s.
TEST(Fault, NakForEverOnOutLeavesTheMotorsToTheWatchdogAndHoldsNobodyUp) {
  const auto begun = std::chrono::steady_clock::now();
  expect_watchdog("nak-out", {"stale_reports"});
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  measured("run_and_end", took_s, "s");
  EXPECT_LT(took_s, 30.0);
}

// --- firmware and motors ---

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
