// SPDX-License-Identifier: Apache-2.0
// `forcegrid chart two-tools` as its user starts it, on the small scene.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/command_test.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::text_of;

class ChartTwoTools : public testing::CommandTest {
 protected:
  ChartTwoTools() : CommandTest(std::chrono::seconds(200)) {}

  const std::string folder_ = fresh_folder("chart_two_tools");
  const std::string cache_ = fresh_folder("chart_two_tools_cache");
};

TEST_F(ChartTwoTools, WritesTracesThatEvaluateReadsWithTheSameErrors) {
  ASSERT_EQ(run({"chart", "two-tools", "--out", folder_, "--cache", cache_, "--scenes", "small",
                 "--pairs", "hold_chirp,stretch", "--seconds", "1.5", "--parts", "errors",
                 "--methods", "hold;kriging-6d samples=8", "--goals-for", "kriging-6d samples=8"}),
            0)
      << error_;
  EXPECT_THAT(out_, HasSubstr("Goals, method kriging-6d samples=8"));
  EXPECT_THAT(out_, HasSubstr("of 4 goals met"));
  const json chart = json::parse(text_of(folder_ + "/two_tools.json"));
  ASSERT_EQ(chart["rows"].size(), 4U);
  EXPECT_EQ(chart["unconverged_instants"], 0);
  for (const json& row : chart["rows"]) {
    ASSERT_EQ(run({"evaluate", "--method", row["method"], "--trace",
                   folder_ + "/traces/small-" + row["pair"].get<std::string>() + ".csv.gz"}),
              0)
        << error_;
    EXPECT_EQ(json::parse(out_)["rms_error_percent_after_1s"], row["rms_error_percent_after_1s"]);
  }
}

TEST_F(ChartTwoTools, GivesTheSamplesTheirStiffnessIfAsked) {
  const std::vector<std::string> command{
      "chart",    "two-tools", "--out",     folder_,   "--cache",     cache_,
      "--scenes", "small",     "--pairs",   "stretch", "--seconds",   "1.5",
      "--parts",  "errors",    "--methods", "auto-6d", "--goals-for", "auto-6d"};
  ASSERT_EQ(run(command), 0) << error_;
  const json without = json::parse(text_of(folder_ + "/two_tools.json"));
  EXPECT_EQ(without["stiffness"], false);
  std::vector<std::string> with_stiffness = command;
  with_stiffness.push_back("--stiffness");
  ASSERT_EQ(run(with_stiffness), 0) << error_;
  const json with = json::parse(text_of(folder_ + "/two_tools.json"));
  EXPECT_EQ(with["stiffness"], true);
  EXPECT_LT(with["rows"][0]["rms_error_percent_first_1s"].get<double>(),
            0.7 * without["rows"][0]["rms_error_percent_first_1s"].get<double>());
  const std::string trace = folder_ + "/traces/small-stretch.csv.gz";
  ASSERT_EQ(run({"evaluate", "--method", "auto-6d", "--trace", trace}), 0) << error_;
  EXPECT_EQ(json::parse(out_)["rms_error_percent_first_1s"],
            with["rows"][0]["rms_error_percent_first_1s"]);
  ASSERT_EQ(run({"evaluate", "--method", "auto-6d", "--trace", trace, "--no-stiffness"}), 0)
      << error_;
  EXPECT_EQ(json::parse(out_)["rms_error_percent_first_1s"],
            without["rows"][0]["rms_error_percent_first_1s"]);
}

TEST_F(ChartTwoTools, DelaysEveryAnswerByTheDelay) {
  const std::vector<std::string> command{
      "chart",    "two-tools", "--out",     folder_,   "--cache",     cache_,
      "--scenes", "small",     "--pairs",   "stretch", "--seconds",   "1.5",
      "--parts",  "errors",    "--methods", "hold",    "--goals-for", "hold"};
  ASSERT_EQ(run(command), 0) << error_;
  const json soon = json::parse(text_of(folder_ + "/two_tools.json"));
  std::vector<std::string> delayed = command;
  delayed.insert(delayed.end(), {"--delay-ms", "100"});
  ASSERT_EQ(run(delayed), 0) << error_;
  const json late = json::parse(text_of(folder_ + "/two_tools.json"));
  // hold is wrong by what the force changes in a sample's age: 50 ms on average, or 150 ms.
  EXPECT_GT(late["rows"][0]["rms_error_percent_after_1s"].get<double>(),
            2.0 * soon["rows"][0]["rms_error_percent_after_1s"].get<double>());
}

TEST_F(ChartTwoTools, SearchesTheStiffnessLimitsOfTwoHands) {
  ASSERT_EQ(run({"chart", "two-tools", "--out", folder_, "--cache", cache_, "--quick", "--parts",
                 "stability", "--methods", "hold;kriging-6d", "--goals-for", "kriging-6d"}),
            0)
      << error_;
  EXPECT_THAT(out_, HasSubstr("Goal, method kriging-6d on springs: at least 0.95, met"));
  EXPECT_THAT(
      text_of(folder_ + "/stability.md"),
      HasSubstr("| object | hand | servo | tools | network | `exact` | `hold` | `kriging-6d` |"));
  EXPECT_FALSE(std::filesystem::exists(folder_ + "/two_tools.md"));
}

TEST_F(ChartTwoTools, RefusesWhatItDoesNotKnow) {
  const auto refused = [this](const std::string& flag, const std::string& value) {
    EXPECT_NE(run({"chart", "two-tools", "--out", folder_, "--cache", cache_, flag, value}), 0);
    return error_ + out_;
  };
  EXPECT_THAT(refused("--pairs", "waltz"), HasSubstr("hold_chirp"));
  EXPECT_THAT(refused("--scenes", "nowhere"), HasSubstr("'nowhere' is not in the chart"));
  EXPECT_THAT(refused("--methods", "kriging-7d"), HasSubstr("known methods: auto-6d"));
  EXPECT_THAT(refused("--parts", "cost"), HasSubstr("stability"));
  EXPECT_THAT(refused("--seconds", "0.5"), HasSubstr("--seconds"));
  EXPECT_FALSE(std::filesystem::exists(folder_ + "/traces"));
}

TEST_F(ChartTwoTools, RefusesAnObjectThatHasNoForceOfPositions) {
  EXPECT_EQ(run({"chart", "two-tools", "--out", folder_, "--parts", "stability", "--quick",
                 "--objects", "springs,small_slide"}),
            1);
  EXPECT_THAT(error_, HasSubstr("scene small_slide: its tool slides"));
}

// Traces are kept, so that "repeat the command to continue" is true of them alone.
TEST_F(ChartTwoTools, DoesNotSayThatAStoppedSearchIsKept) {
  testing::Program program =
      testing::Program::forcegrid({"chart", "two-tools", "--out", folder_, "--cache", cache_,
                                   "--parts", "stability", "--objects", "small", "--quick"});
  ASSERT_TRUE(program.wait_for_text("Searching for stiffness limits"));
  program.send_signal(SIGINT);
  EXPECT_EQ(program.wait(std::chrono::seconds(20)), 130);
  EXPECT_THAT(program.standard_error(), HasSubstr("forcegrid: stopped by SIGINT"));
  EXPECT_THAT(program.standard_error(), ::testing::Not(HasSubstr("kept")));
}

}  // namespace
}  // namespace forcegrid
