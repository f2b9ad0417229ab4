// SPDX-License-Identifier: Apache-2.0
// `forcegrid chart accuracy` as its user starts it, on the small scene.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;
using testing::text_of;

constexpr std::chrono::seconds kPatience{200};

class ChartAccuracy : public ::testing::Test {
 protected:
  // The force table is made once for all tests of a run.
  static void SetUpTestSuite() { cache_ = fresh_folder("chart_cache"); }

  std::vector<std::string> command(const std::string& out, const std::string& trajectories,
                                   const std::string& conditions, const std::string& methods) {
    return {"chart",     "accuracy", "--out",          out,          "--cache",      cache_,
            "--scenes",  "small",    "--trajectories", trajectories, "--conditions", conditions,
            "--methods", methods};
  }

  int run(const std::vector<std::string>& arguments) {
    Program program = Program::forcegrid(arguments);
    const auto status = program.wait(kPatience);
    out_ = program.standard_output();
    error_ = program.standard_error();
    return status.value_or(-1);
  }

  static json result(const std::string& folder) {
    return json::parse(text_of(folder + "/accuracy.json"), nullptr, false);
  }

  static const json* row_of(const json& chart, const std::string& trajectory,
                            const std::string& condition, const std::string& method) {
    for (const json& row : chart.at("rows")) {
      if (row.at("trajectory") == trajectory && row.at("condition") == condition &&
          row.at("method") == method) {
        return &row;
      }
    }
    return nullptr;
  }

  static std::string cache_;
  std::string out_;
  std::string error_;
};

std::string ChartAccuracy::cache_;

TEST_F(ChartAccuracy, JudgesWritesAndGoesOnWhereItWas) {
  const std::string folder = fresh_folder("chart");
  ASSERT_EQ(run(command(folder, "chirp,circle", "ideal,stiffness", "hold;forcegrid;tangent")), 0)
      << error_;
  EXPECT_THAT(error_, HasSubstr("small: force table"));
  EXPECT_THAT(error_, HasSubstr("% (RMS) at 200 positions of a motion"));
  const json chart = result(folder);
  ASSERT_TRUE(chart.is_object());
  // hold and forcegrid under both conditions, tangent where there is stiffness; two trajectories.
  ASSERT_EQ(chart.at("rows").size(), 10U);
  EXPECT_EQ(row_of(chart, "chirp", "ideal", "tangent"), nullptr);

  // The method study's figures for this motion on such blocks, within 20 %.
  const json* hold = row_of(chart, "chirp", "ideal", "hold");
  const json* grid = row_of(chart, "chirp", "ideal", "forcegrid");
  const json* tangent = row_of(chart, "chirp", "stiffness", "tangent");
  ASSERT_TRUE(hold != nullptr && grid != nullptr && tangent != nullptr);
  EXPECT_NEAR(hold->at("rms_error_percent_after_1s").get<double>(), 36.8, 7.4);
  EXPECT_NEAR(grid->at("rms_error_percent_after_1s").get<double>(), 10.8, 2.2);
  EXPECT_NEAR(tangent->at("rms_error_percent_after_1s").get<double>(), 5.8, 1.2);
  EXPECT_TRUE(hold->at("loop_work_percent").is_null());
  // Streaming lags by 50 ms: on an isotropic spring that feeds pi K r^2 sin(w T), 156 % of the
  // stored energy, into the hand at every turn; sideways this block is stiffer.
  const json* circling = row_of(chart, "circle", "ideal", "hold");
  ASSERT_NE(circling, nullptr);
  EXPECT_GT(circling->at("loop_work_percent").get<double>(), 156.0);
  EXPECT_LT(circling->at("loop_work_percent").get<double>(), 400.0);
  EXPECT_LT(chart.at("scenes").at(0).at("difference_along_motion").at("rms_percent"), 0.1);
  for (const char* const name :
       {"/accuracy.csv", "/index.html", "/error_against_cost_small.svg",
        "/figures/small-chirp-ideal/forces.svg", "/figures/small-chirp-ideal/forces.csv"}) {
    EXPECT_TRUE(std::filesystem::exists(folder + name)) << name;
  }

  // One method more: the ten rows stay as they are.
  const std::string before = text_of(folder + "/rows.jsonl");
  ASSERT_EQ(
      run(command(folder, "chirp,circle", "ideal,stiffness", "hold;forcegrid;tangent;linear")), 0)
      << error_;
  const json more = result(folder);
  EXPECT_EQ(more.at("rows").size(), 14U);
  EXPECT_EQ(more.at("rows_kept"), 10);
  EXPECT_EQ(text_of(folder + "/rows.jsonl").substr(0, before.size()), before);
  EXPECT_THAT(out_, HasSubstr("14 rows (10 of them from an earlier call)"));
}

TEST_F(ChartAccuracy, GoesOnAfterCtrlC) {
  const std::string folder = fresh_folder("chart_stopped");
  const std::vector<std::string> arguments =
      command(folder, "chirp,lissajous,random", "ideal,delay100,lossy,rate60",
              "forcegrid;forcegrid cells=80;forcegrid r=20mm;forcegrid unit=m");
  std::size_t lines = 0;
  {
    Program program = Program::forcegrid(arguments);
    const std::string rows = folder + "/rows.jsonl";
    for (int i = 0; i < 10000 && lines < 2; ++i) {
      const std::string text = text_of(rows);
      lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    program.send_signal(SIGINT);
    EXPECT_EQ(program.wait(kPatience), 1);
    EXPECT_THAT(program.standard_error(), HasSubstr("repeat the command to continue"));
  }
  ASSERT_GE(lines, 2U);
  ASSERT_EQ(run(arguments), 0) << error_;
  const json chart = result(folder);
  EXPECT_EQ(chart.at("rows").size(), 48U);
  EXPECT_GE(chart.at("rows_kept").get<std::size_t>(), lines);
  EXPECT_LT(chart.at("rows_kept").get<std::size_t>(), 48U);
}

TEST_F(ChartAccuracy, NamesWhatItDoesNotKnow) {
  const std::string folder = fresh_folder("chart_refused");
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--scenes", "marmalade"}), 2);
  EXPECT_THAT(error_, HasSubstr("marmalade"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--trajectories", "wobble"}), 2);
  EXPECT_THAT(error_, HasSubstr("wobble"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--conditions", "pigeon"}), 2);
  EXPECT_THAT(error_, HasSubstr("pigeon"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--methods", "hold;magic"}), 1);
  EXPECT_THAT(error_, HasSubstr("'magic' is not known"));
  EXPECT_EQ(run({"chart", "accuracy", "--out", folder, "--figures", "small/chirp"}), 1);
  EXPECT_THAT(error_, HasSubstr("SCENE/TRAJECTORY/CONDITION"));
  EXPECT_EQ(run({"chart", "accuracy"}), 2);
  EXPECT_THAT(error_, HasSubstr("--out"));
  EXPECT_EQ(run(command(folder, "chirp", "ideal", "tangent")), 1);
  EXPECT_THAT(error_, HasSubstr("add the condition stiffness"));
}

TEST_F(ChartAccuracy, NamesAFolderThatItCantUse) {
  EXPECT_EQ(run(command("/dev/null/chart", "chirp", "ideal", "hold")), 1);
  EXPECT_THAT(error_, HasSubstr("/dev/null/chart"));
}

TEST_F(ChartAccuracy, DirectIsJudgedLiveAndIsTheMostAccurate) {
  const std::string folder = fresh_folder("chart_direct");
  ASSERT_EQ(run(command(folder, "poke", "ideal,delay100", "direct;hold")), 0) << error_;
  const json chart = result(folder);
  const json* direct = row_of(chart, "poke", "ideal", "direct");
  ASSERT_NE(direct, nullptr);
  EXPECT_EQ(row_of(chart, "poke", "delay100", "direct"), nullptr);
  EXPECT_LT(direct->at("rms_error_percent_after_1s"), 0.1);
  EXPECT_LT(direct->at("rms_error_percent_first_1s"), 0.5);
  EXPECT_GT(chart.at("scenes").at(0).at("direct_cycle_us"), 1.0);
}

}  // namespace
}  // namespace forcegrid
