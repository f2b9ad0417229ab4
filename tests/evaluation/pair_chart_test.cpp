// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/pair_chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "evaluation/files/error.h"
#include "evaluation/judge/pair_judge.h"
#include "forcegrid/pair_methods.h"

namespace forcegrid::evaluation {
namespace {

using ::testing::HasSubstr;

class PairChartTest : public ::testing::Test {
 public:
  ~PairChartTest() override { std::filesystem::remove_all(folder_); }

 protected:
  PairChartTest() { std::filesystem::remove_all(folder_); }

  PairChartOptions quick() const {
    PairChartOptions options;
    options.out = folder_;
    options.scenes = {"small"};
    options.pairs = {"hold_chirp"};
    options.methods = {"hold", "rls", "kriging-6d samples=8"};
    options.goals_for = "kriging-6d samples=8";
    options.seconds = 1.5;
    options.jobs = 1;
    return options;
  }

  static std::string content(const std::filesystem::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  const std::filesystem::path folder_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string("pair_chart_") +
       ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(PairChartTest, JudgesEveryMethodOnTheTraceThatItWrites) {
  const PairChartOptions options = quick();
  const PairChart chart = make_pair_chart(options);
  EXPECT_EQ(chart.unconverged, 0U);
  EXPECT_EQ(chart.branch_changes, 0U);
  ASSERT_EQ(chart.rows.size(), 3U);
  EXPECT_FALSE(chart.rows[1].coupled);
  EXPECT_TRUE(chart.rows[2].coupled);
  // The same again from the file.
  const PairTrace trace =
      read_pair_trace((folder_ / "traces" / "small-hold_chirp.csv.gz").string());
  const auto hold = make_pair_force_method("hold", {});
  EXPECT_EQ(judge_pair(*hold, trace).together.after_1s.rms_percent,
            chart.rows[0].verdict.together.after_1s.rms_percent);
  // The goals, from the rows.
  ASSERT_EQ(chart.numbers.size(), 4U);
  const double best_percent = std::min(chart.rows[0].verdict.together.after_1s.rms_percent,
                                       chart.rows[1].verdict.together.after_1s.rms_percent);
  ASSERT_GT(best_percent, 1.0);
  const double own_percent = chart.rows[2].verdict.together.after_1s.rms_percent;
  EXPECT_NEAR(chart.numbers[0].measured, own_percent, 1e-9);
  EXPECT_NEAR(chart.numbers[1].measured, own_percent / best_percent, 1e-12);
  EXPECT_EQ(chart.numbers[1].worst, "hold_chirp");
  EXPECT_EQ(chart.numbers[2].measured,
            chart.rows[2].verdict.query_ns_median / chart.rows[2].trilinear_read_ns);
  EXPECT_EQ(chart.numbers[3].measured,
            1e-6 * static_cast<double>(chart.rows[2].verdict.memory_bytes));
}

PairChartRow row(const std::string& pair, const std::string& method, double percent) {
  PairChartRow made{"small", pair, method, true, {}, 2.0};
  made.verdict.together.after_1s.rms_percent = percent;
  made.verdict.query_ns_median = 30.0;
  made.verdict.memory_bytes = 3'000'000;
  return made;
}

TEST_F(PairChartTest, TakesTheGeometricMeanOfAMethodOverThePairs) {
  PairChart chart;
  chart.rows = {row("a", "m", 0.5), row("a", "other", 7.0), row("b", "m", 2.0), row("c", "m", 8.0)};
  EXPECT_NEAR(geometric_mean_percent(chart, "small", "m"), 2.0, 1e-12);
  EXPECT_TRUE(std::isnan(geometric_mean_percent(chart, "block", "m")));
  EXPECT_NEAR(chart.rows[0].query_reads(), 15.0, 1e-12);
}

TEST_F(PairChartTest, WritesTableDataAndPage) {
  PairChart chart;
  chart.rows = {row("a", "m", 0.5), row("b", "m", 2.0)};
  chart.numbers = {{"memory", 3.0, 20.0, "MB", "a"}, {"query", NAN, 20.0, "", ""}};
  PairChartOptions options = quick();
  std::filesystem::create_directories(folder_);
  const auto files = write_pair_chart(chart, options);
  ASSERT_EQ(files.size(), 3U);
  EXPECT_THAT(content(files[0]),
              HasSubstr("scene,pair,method,coupled,rms_error_percent_after_1s,"));
  EXPECT_THAT(content(files[0]), HasSubstr("\nsmall,b,m,1,2,"));
  const auto json = nlohmann::json::parse(content(files[1]));
  EXPECT_EQ(json["rows"].size(), 2U);
  EXPECT_EQ(json["rows"][1]["query_reads"], 15.0);
  EXPECT_EQ(json["goals"][0]["met"], true);
  EXPECT_TRUE(json["goals"][1]["measured"].is_null());
  EXPECT_EQ(json["goals"][1]["met"], false);
  EXPECT_THAT(content(files[2]), HasSubstr("| `m` | 0.500 | 2.00 | 1.00 | 15.0 |"));
  EXPECT_THAT(content(files[2]), HasSubstr("not in this selection"));
}

TEST_F(PairChartTest, RefusesWhatItDoesNotKnowBeforeItSolvesAnything) {
  for (const auto change : {+[](PairChartOptions& o) { o.scenes = {"nowhere"}; },
                            +[](PairChartOptions& o) { o.scenes = {}; },
                            +[](PairChartOptions& o) { o.pairs = {"waltz"}; },
                            +[](PairChartOptions& o) { o.methods = {"tangent"}; },
                            +[](PairChartOptions& o) { o.goals_for = "kriging-6d samples=99"; }}) {
    PairChartOptions options = quick();
    change(options);
    EXPECT_THROW(make_pair_chart(options), ChartError);
    EXPECT_FALSE(std::filesystem::exists(folder_ / "traces"));
  }
}

}  // namespace
}  // namespace forcegrid::evaluation
