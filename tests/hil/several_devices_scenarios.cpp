// SPDX-License-Identifier: Apache-2.0
// Two attached devices of one kind hold one object in one program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/hil_bench.h"
#include "tests/support/program.h"

namespace forcegrid::hil {
namespace {

using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::Not;

/// The second device beside the first in a run's arguments.
std::vector<std::string> and_second(const Bench& bench) {
  return {"--calibrated", "--device", "hid:path=" + bench.nodes().at(1).port};
}

std::string first(const Bench& bench) { return "hid:path=" + bench.nodes().at(0).port; }

nlohmann::json summary_in(const std::string& folder) {
  std::ifstream file(folder + "/summary.json");
  return nlohmann::json::parse(file, nullptr, false);
}

/// Both emulated arms have pushed, and their motors have no current now.
void expect_pushed_and_off(const nlohmann::json& reports) {
  ASSERT_TRUE(reports.is_array()) << reports;
  ASSERT_EQ(reports.size(), 2U);
  for (const auto& report : reports) {
    EXPECT_THAT(report.at("final_current_mA").get<std::vector<double>>(), Each(0.0));
    const auto peak_mA = report.at("max_abs_current_mA").get<std::vector<double>>();
    EXPECT_GT(*std::max_element(peak_mA.begin(), peak_mA.end()), 0.0) << "its motors never pushed";
  }
}

class TwoDevices : public ::testing::Test {
 protected:
  void SetUp() override {
    if (bench_.nodes().size() != 2) {
      FAIL() << "two nodes are needed, there are " << bench_.nodes().size();
    }
  }
  Bench bench_{{"woodenhaptics_v2015", "woodenhaptics_v2015"},
               {"--calibrated", "--motion", "hold"}};
};

using LongTwoDevices = TwoDevices;

// Their serial numbers are the same, so only the ports tell them apart.
TEST_F(LongTwoDevices, HoldOneObjectToTheEnd) {
  const EndedRun felt = run(first(bench_), 5.0, and_second(bench_));
  EXPECT_EQ(felt.status, 0) << felt.text;
  ASSERT_TRUE(felt.summary.is_object()) << felt.text;
  const auto& devices = felt.summary.at("devices");
  ASSERT_EQ(devices.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(devices[i].at("ended_by"), "time") << felt.text;
    EXPECT_TRUE(devices[i].at("zero_current_delivered").get<bool>());
    EXPECT_THAT(devices[i].at("several_tools").at("unit").at("url").get<std::string>(),
                HasSubstr(bench_.nodes()[i].port));
  }
  expect_pushed_and_off(bench_.end());
}

TEST_F(LongTwoDevices, StopBothWhenOneIsUnpluggedInMidForce) {
  const std::string folder = forcegrid::testing::fresh_folder("two");
  Program program =
      Program::forcegrid(run_arguments(first(bench_), 60.0, folder, and_second(bench_)));
  program.wait_for_line("device 1: Simulator: ");
  // The operators are at the object 1.7 s after the first command, and stay there.
  std::this_thread::sleep_for(seconds(4));
  bench_.unplug();
  const auto status = program.wait(seconds(20));
  const std::string text = program.standard_output() + program.standard_error();
  EXPECT_EQ(status.value_or(-1), 1) << text;
  EXPECT_THAT(text, AllOf(HasSubstr("The device is gone"), Not(HasSubstr("terminate called"))));

  const nlohmann::json summary = summary_in(folder);
  ASSERT_TRUE(summary.is_object()) << text;
  const auto& pulled = summary.at("devices").at(0);
  const auto& other = summary.at("devices").at(1);
  ASSERT_EQ(pulled.at("faults").size(), 1U);
  EXPECT_EQ(pulled.at("faults")[0].at("name"), "unplugged");
  EXPECT_FALSE(pulled.at("zero_current_delivered").get<bool>()) << "it has no cable";
  EXPECT_EQ(other.at("ended_by"), "other_device");
  EXPECT_TRUE(other.at("faults").empty()) << other.at("faults");
  EXPECT_TRUE(other.at("zero_current_delivered").get<bool>());

  std::this_thread::sleep_for(seconds(2));  // longer than the pulled one's watchdog takes
  const nlohmann::json reports = bench_.end();
  expect_pushed_and_off(reports);
  EXPECT_GE(reports.at(0).at("watchdog_trips").get<int>(), 1);
}

}  // namespace
}  // namespace forcegrid::hil
