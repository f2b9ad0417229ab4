// SPDX-License-Identifier: Apache-2.0
#include "tests/hil/faulty_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <thread>

namespace forcegrid::hil {

using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

const nlohmann::json kMotorsOff = {0, 0, 0};

namespace {

bool is_falcon(const nlohmann::json& emulator) { return emulator.contains("final_command"); }

}  // namespace

nlohmann::json final_command(const nlohmann::json& emulator) {
  return emulator.at(is_falcon(emulator) ? "final_command" : "final_current_mA");
}

double largest_command(const nlohmann::json& emulator) {
  const auto peak = emulator.at(is_falcon(emulator) ? "max_abs_command" : "max_abs_current_mA")
                        .get<std::vector<double>>();
  return *std::max_element(peak.begin(), peak.end());
}

std::int64_t number(const nlohmann::json& json, const char* key) {
  return json.at(key).get<std::int64_t>();
}

void expect_named(const FaultyRun& run, const std::vector<std::string>& names) {
  const EndedRun& felt = run.felt;
  ASSERT_TRUE(felt.summary.is_object());
  EXPECT_EQ(felt.status, 1) << felt.text;
  EXPECT_EQ(felt.text.find("FAULT"), felt.text.rfind("FAULT")) << felt.text;
  ASSERT_EQ(felt.summary.at("faults").size(), 1U) << felt.text;
  EXPECT_THAT(names, Contains(felt.summary.at("faults")[0].at("name").get<std::string>()))
      << felt.text;
  EXPECT_THAT(felt.text, HasSubstr(felt.summary.at("faults")[0].at("sentence")));
}

double seconds_until_motors_off(const FaultyRun& run) {
  const auto& faults = run.emulator.at("faults");
  EXPECT_EQ(faults.size(), 1U) << run.emulator;
  if (faults.empty() || !faults[0].contains("seconds_until_motors_off") ||
      !faults[0].at("seconds_until_motors_off").is_number()) {
    ADD_FAILURE() << "the fault never acted, or the motors never stopped: " << run.emulator;
    return 1e9;
  }
  const double taken_s = faults[0].at("seconds_until_motors_off").get<double>();
  measured("motors_off_after_fault", taken_s, "s");
  return taken_s;
}

void expect_motors_off(const FaultyRun& run, const std::vector<std::string>& names,
                       double within_s) {
  expect_named(run, names);
  if (!run.felt.summary.is_object()) {
    return;
  }
  if (!run.felt.summary.at("zero_current_delivered").get<bool>()) {
    EXPECT_THAT(run.felt.text, HasSubstr("watchdog"));
  }
  EXPECT_GT(largest_command(run.emulator), 0.0) << "the motors never pushed";
  EXPECT_LE(seconds_until_motors_off(run), within_s) << run.felt.text;
}

void expect_zero_sent(const FaultyRun& run, const std::vector<std::string>& names,
                      double within_s) {
  expect_motors_off(run, names, within_s);
  EXPECT_TRUE(run.felt.summary.value("zero_current_delivered", false)) << run.felt.text;
}

void expect_watchdog(const FaultyRun& run, const std::vector<std::string>& names, double within_s) {
  expect_motors_off(run, names, within_s);
  EXPECT_FALSE(run.felt.summary.value("zero_current_delivered", true)) << run.felt.text;
}

void expect_endured(const FaultyRun& run) {
  EXPECT_EQ(run.felt.status, 0) << run.felt.text;
  ASSERT_TRUE(run.felt.summary.is_object());
  EXPECT_TRUE(run.felt.summary.at("faults").empty()) << run.felt.text;
  EXPECT_TRUE(run.felt.summary.at("zero_current_delivered").get<bool>()) << run.felt.text;
  EXPECT_GT(largest_command(run.emulator), 0.0) << "the motors never pushed";
  ASSERT_EQ(run.emulator.at("faults").size(), 1U);
  EXPECT_GT(number(run.emulator.at("faults")[0], "times"), 0) << "the fault never acted";
}

void expect_orderly_end(const FaultyRun& run) {
  EXPECT_EQ(final_command(run.emulator), kMotorsOff) << run.felt.text;
  EXPECT_TRUE(run.felt.summary.is_object()) << run.felt.text;
  EXPECT_THAT(run.felt.text, Not(HasSubstr("terminate called")));
}

void expect_wrong_way_motor(const FaultyRun& run) {
  expect_named(run, {"motor_wrong_way"});
  EXPECT_THAT(run.felt.text, HasSubstr("The motor of joint b pushes the wrong way"));
  EXPECT_TRUE(run.felt.summary.value("zero_current_delivered", false));
}

nlohmann::json expect_refused_with_stalled_control(const std::string& device,
                                                   const std::function<EndedRun()>& try_to_run,
                                                   const char* words) {
  const std::string report_file = forcegrid::testing::fresh_folder("stalled") + "/report.json";
  Program emulator =
      Program::forcegrid({"emulate", "--device", device, "--listen", "127.0.0.1:3240", "--fault",
                          "stall-control", "--json", report_file});
  EXPECT_TRUE(emulator.wait_for_text("busid 1-1"));
  shell("usbip attach -r 127.0.0.1 -b 1-1");
  std::this_thread::sleep_for(std::chrono::seconds(5));
  const EndedRun refused = try_to_run();
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, HasSubstr(words));
  shell("usbip detach -p 0");
  emulator.send_signal(SIGTERM);
  EXPECT_EQ(emulator.wait(std::chrono::seconds(20)).value_or(-1), 128 + SIGTERM)
      << emulator.standard_error();
  std::ifstream file(report_file);
  nlohmann::json report = nlohmann::json::parse(file, nullptr, false);
  EXPECT_TRUE(report.is_object());
  if (report.is_object()) {
    EXPECT_EQ(largest_command(report), 0.0);
  }
  return report;
}

void expect_sound_kernel() {
  EXPECT_THAT(shell("dmesg").text,
              Not(AnyOf(HasSubstr("BUG:"), HasSubstr("Oops"), HasSubstr("Call Trace"))));
}

}  // namespace forcegrid::hil
