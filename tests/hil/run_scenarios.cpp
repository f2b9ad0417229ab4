// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Clock = std::chrono::steady_clock;

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// No fault, and the zero at the end has left. Software emulation may not keep the rate; a fifth of
/// it is no rate to speak of.
void expect_sound(const EndedRun& run, double seconds) {
  ASSERT_EQ(run.status, 0) << run.text;
  ASSERT_TRUE(run.summary.is_object()) << run.text;
  EXPECT_TRUE(run.summary.at("faults").empty()) << run.summary.at("faults");
  EXPECT_TRUE(run.summary.at("zero_current_delivered").get<bool>());
  EXPECT_GT(run.summary.at("cycles").get<double>(),
            0.2 * seconds * run.summary.at("servo_rate_requested_Hz").get<double>());
}

void expect_motors_off(const nlohmann::json& emulator) {
  EXPECT_EQ(emulator.at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0})) << emulator;
}

/// Every OUT report of the driver reached the device. Every IN report that the device sent was
/// used, or skipped as stale and counted, but for
///   - those that usbhid throws away during 50 ms after the open: the driver, seeing none, kicks,
///   so
///     there is one of them for each kick;
///   - the one that the last zero command releases and nobody waits for.
void expect_every_report_accounted_for(const nlohmann::json& run, const nlohmann::json& emulator) {
  const auto number = [](const nlohmann::json& json, const char* key) {
    return json.at(key).get<std::int64_t>();
  };
  EXPECT_EQ(number(emulator, "reports_received"), number(run, "commands_sent"));
  EXPECT_EQ(number(emulator, "short_reports") + number(emulator, "long_reports"), 0);
  const std::int64_t used = number(run, "reports_received");
  const std::int64_t stale = number(run, "reports_discarded") + number(run, "reports_drained");
  const std::int64_t unseen = number(emulator, "reports_sent") - used - stale;
  const std::int64_t kicks = number(run, "kicks");
  EXPECT_EQ(number(run, "reports_rejected"), 0);
  EXPECT_GE(number(run, "reports_discarded"), 1);
  EXPECT_LE(unseen, kicks + 1);
  if (number(run, "reports_lost") == 0) {
    EXPECT_GE(unseen, kicks);
  }
  measured("reports_sent_by_device", static_cast<double>(number(emulator, "reports_sent")), "1");
  measured("reports_used", static_cast<double>(used), "1");
  measured("reports_stale", static_cast<double>(stale), "1");
  measured("reports_unseen_at_open_and_end", static_cast<double>(unseen), "1");
  measured("kicks", static_cast<double>(kicks), "1");
}

void report_timing(const nlohmann::json& run) {
  measured("servo_rate", run.at("servo_rate_Hz").get<double>(), "Hz");
  measured("missed_deadlines", run.at("missed_deadlines").get<double>(), "1");
  for (const char* what : {"period_us", "compute_us", "report_age_us"}) {
    for (const char* part : {"p50", "p99", "max"}) {
      measured(std::string(what).substr(0, std::string(what).size() - 3) + "_" + part,
               run.at(what).at(part).get<double>(), "us");
    }
  }
}

void expect_contact(const EndedRun& run) {
  EXPECT_GT(run.summary.at("samples_received").get<std::uint64_t>(), 0U) << run.text;
}

// The whole: calibration by the emulated operator, approach, contact, forces.
TEST(OpenAndRun, ByVendorAndProductWithCalibrationAndContact) {
  Bench bench;
  constexpr double kSeconds = 3.5;  // the hand is at the object after 1.7
  const EndedRun felt = run("hid:1234:0006", kSeconds);
  expect_sound(felt, kSeconds);
  expect_contact(felt);
  EXPECT_THAT(felt.text, HasSubstr("HID DEVICE (mbed.org, serial 0123456789)"));
  const nlohmann::json emulator = bench.end();
  expect_motors_off(emulator);
  EXPECT_EQ(emulator.at("counters_loaded"), 1);
  const auto peak_mA = emulator.at("max_abs_current_mA").get<std::vector<double>>();
  EXPECT_GT(*std::max_element(peak_mA.begin(), peak_mA.end()), 0.0) << "the motors never pushed";
  expect_every_report_accounted_for(felt.summary, emulator);
  report_timing(felt.summary);
}

TEST(LongOpenAndRun, ByNode) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const EndedRun felt = run("hid:" + bench.node().dev(), 2.0, {"--calibrated"});
  expect_sound(felt, 2.0);
  const nlohmann::json emulator = bench.end();
  expect_motors_off(emulator);
  expect_every_report_accounted_for(felt.summary, emulator);
}

TEST(LongOpenAndRun, ByPortSerialAndLinkOneAfterTheOther) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const auto link = std::filesystem::directory_iterator("/dev/forcegrid")->path().string();
  for (const std::string& url :
       {"hid:path=" + bench.node().port, std::string("hid:1234:0006:0123456789"), "hid:" + link}) {
    SCOPED_TRACE(url);
    expect_sound(run(url, 1.0, {"--calibrated"}), 1.0);
  }
  expect_motors_off(bench.end());
}

TEST(LongOpenAndRun, ADeviceOfAnotherProfile) {
  Bench bench({"phantom_desktop"}, {"--calibrated"});
  const EndedRun felt = run("hid:1209:0001", 1.0, {"--calibrated", "--profile", "phantom_desktop"});
  expect_sound(felt, 1.0);
  expect_motors_off(bench.end());
}

TEST(LongOpenAndRun, OfTwoAlikeTheOneAtTheNamedPort) {
  Bench bench({"woodenhaptics_v2015", "woodenhaptics_v2015"}, {"--calibrated"});
  ASSERT_EQ(bench.nodes().size(), 2U);
  const EndedRun refused = run("hid:1234:0006", 1.0, {"--calibrated"});
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, HasSubstr("2 devices match"));
  for (const Node& node : bench.nodes()) {
    EXPECT_THAT(refused.text, HasSubstr("at USB port " + node.port));
  }
  expect_sound(run("hid:path=" + bench.nodes()[1].port, 1.0, {"--calibrated"}), 1.0);
  const nlohmann::json reports = bench.end();
  ASSERT_EQ(reports.size(), 2U);
  int driven = 0;
  for (const nlohmann::json& report : reports) {
    expect_motors_off(report);
    driven += report.at("reports_received").get<int>() > 0 ? 1 : 0;
  }
  EXPECT_EQ(driven, 1) << "only the named one may get commands: " << reports;
}

// The emulated motors push when the cable goes: the device's own watchdog must stop them.
TEST(Unplug, InMidForceStopsTheMotorsWithinHalfASecondAndEndsTheRun) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated", "--motion", "hold"});
  const std::string folder = forcegrid::testing::fresh_folder("unplug");
  Program program =
      Program::forcegrid(run_arguments("hid:1234:0006", 60.0, folder, {"--calibrated"}));
  program.wait_for_line("Simulator: ");
  // The operator is at the object 1.7 s after the first command, and stays there.
  std::this_thread::sleep_for(std::chrono::milliseconds(3000));
  const auto pulled = Clock::now();
  bench.unplug();
  const auto gone = Clock::now();
  const auto status = program.wait(std::chrono::seconds(20));
  const double ended_s = seconds_between(pulled, Clock::now());
  EXPECT_EQ(status.value_or(-1), 1);
  const std::string text = program.standard_output() + program.standard_error();
  EXPECT_THAT(text, HasSubstr("FAULT: The device is gone; check the cable, plug it in again, and "
                              "start again."));
  EXPECT_EQ(text.find("FAULT"), text.rfind("FAULT")) << text;
  EXPECT_THAT(text, Not(HasSubstr("terminate called")));

  std::ifstream file(folder + "/summary.json");
  const nlohmann::json summary = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(summary.is_object()) << text;
  ASSERT_EQ(summary.at("faults").size(), 1U);
  EXPECT_EQ(summary.at("faults")[0].at("name"), "unplugged");
  EXPECT_FALSE(summary.at("zero_current_delivered").get<bool>())
      << "no cable, so nothing can be known to have been delivered";
  EXPECT_TRUE(std::filesystem::exists(folder + "/flight_record.csv"));

  // Long enough for the watchdog to have tripped even on a slow machine.
  std::this_thread::sleep_for(std::chrono::seconds(3));
  const auto asked = Clock::now();
  const nlohmann::json emulator = bench.end();
  expect_motors_off(emulator);
  EXPECT_GE(emulator.at("watchdog_trips").get<int>(), 1);
  const auto peak_mA = emulator.at("max_abs_current_mA").get<std::vector<double>>();
  EXPECT_GT(*std::max_element(peak_mA.begin(), peak_mA.end()), 0.0) << "the motors never pushed";
  ASSERT_TRUE(emulator.at("seconds_since_motors_nonzero").is_number()) << emulator;
  // The last command may have been taken until the kernel had let go of the device.
  const double off_after_s =
      seconds_between(gone, asked) - emulator.at("seconds_since_motors_nonzero").get<double>();
  constexpr double kWatchdog_s = 0.5;
  constexpr double kLate_s = 0.2;  // how late a thread of the emulator may run in the guest
  EXPECT_LE(off_after_s, kWatchdog_s + kLate_s);
  EXPECT_GT(off_after_s, 0.0) << "the motors had no current when the cable was pulled";
  measured("motors_off_after_unplug", off_after_s, "s");
  measured("run_ended_after_unplug", ended_s, "s");
  measured("peak_current", *std::max_element(peak_mA.begin(), peak_mA.end()), "mA");
}

TEST(LongRun, TheDevicesOwnRateFor20s) {
  Bench bench;
  constexpr double kSeconds = 20.0;
  const EndedRun felt = run("hid:1234:0006", kSeconds, {"--rate", "1000"});
  expect_sound(felt, kSeconds);
  const nlohmann::json emulator = bench.end();
  expect_motors_off(emulator);
  expect_every_report_accounted_for(felt.summary, emulator);
  report_timing(felt.summary);
}

TEST(LongRun, HalfTheDevicesRateFor20s) {
  Bench bench;
  constexpr double kSeconds = 20.0;
  const EndedRun felt = run("hid:1234:0006", kSeconds);
  expect_sound(felt, kSeconds);
  const nlohmann::json emulator = bench.end();
  expect_motors_off(emulator);
  expect_every_report_accounted_for(felt.summary, emulator);
  report_timing(felt.summary);
}

// The runner's own test asks for these by name: they must be seen to fail.
TEST(MadeToFail, AnExpectationThatDoesNotHold) {
  EXPECT_EQ(shell("uname -s").text, "no such kernel\n");
}

TEST(MadeToFail, TheGuestEndsTooEarly) { shell("poweroff -f; sleep 10"); }

TEST(MadeToFail, TheKernelReportsAFaultOfItsOwn) {
  EXPECT_EQ(shell("echo 'BUG: made to fail' > /dev/kmsg").status, 0);
}

TEST(MadeToFail, ItNeverEnds) { std::this_thread::sleep_for(std::chrono::hours(1)); }

}  // namespace
}  // namespace forcegrid::hil
