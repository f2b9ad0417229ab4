// SPDX-License-Identifier: Apache-2.0
#include "tools/tuning_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;

constexpr double kStiffness_N_per_m = 300.0;
constexpr double kAmplitude_m = 0.01;
constexpr double kMotion_rad_per_s = 6.0;

MethodOptions base() {
  MethodOptions options;
  options.grid.max_W = {0.1, 0.1, 0.1};
  options.grid.cells.setConstant(25);
  return options;
}

// 4 s of a sine along x against a spring, at 1 kHz, with a sample 30 times a second that arrives
// one period later.
evaluation::Trace spring_trace() {
  const Eigen::Vector3d centre_W(0.05, 0.05, 0.05);
  const auto position_W = [&](double time_s) -> Eigen::Vector3d {
    return centre_W + Eigen::Vector3d(kAmplitude_m * std::sin(kMotion_rad_per_s * time_s), 0, 0);
  };
  evaluation::Trace trace;
  for (int i = 0; i < 4000; ++i) {
    const double time_s = 1e-3 * i;
    trace.servo.push_back(
        {time_s, position_W(time_s), -kStiffness_N_per_m * (position_W(time_s) - centre_W)});
  }
  constexpr double kPeriod_s = 1.0 / 30.0;
  for (int i = 0; i < 118; ++i) {
    evaluation::DeliveredSample row;
    row.sample.time_s = kPeriod_s * i;
    row.sample.position_W = position_W(row.sample.time_s);
    row.sample.force_W = -kStiffness_N_per_m * (row.sample.position_W - centre_W);
    row.sample.has_stiffness = true;
    row.sample.stiffness_W = -kStiffness_N_per_m * Eigen::Matrix3d::Identity();
    row.delivered_s = row.sample.time_s + kPeriod_s;
    trace.samples.push_back(row);
  }
  return trace;
}

TuningRow setting(const std::string& method, double rate_Hz = 500.0) {
  TuningRow row;
  row.method = method;
  row.rate_Hz = rate_Hz;
  return row;
}

TEST(AtRate, KeepsTheInstantsNearestToTheCyclesOfASlowerLoop) {
  const evaluation::Trace trace = spring_trace();
  EXPECT_EQ(at_rate(trace, 1000.0).servo.size(), 4000u);
  const evaluation::Trace slower = at_rate(trace, 250.0);
  ASSERT_EQ(slower.servo.size(), 1000u);
  EXPECT_EQ(slower.samples.size(), trace.samples.size());
  for (std::size_t i = 0; i < slower.servo.size(); ++i) {
    EXPECT_NEAR(slower.servo[i].time_s, 0.004 * static_cast<double>(i), 1e-9);
  }
  EXPECT_EQ(at_rate(trace, 300.0).servo.size(), 1200u);
}

TEST(Stiffest, IsTheLargestOverAllSamplesAndDirections) {
  evaluation::Trace trace = spring_trace();
  EXPECT_NEAR(stiffest_N_per_m(trace), kStiffness_N_per_m, 1e-9);
  // 500 N/m along (1, 1, 0) / sqrt 2, 100 N/m across it.
  trace.samples[7].sample.stiffness_W << -300, -200, 0, -200, -300, 0, 0, 0, -100;
  EXPECT_NEAR(stiffest_N_per_m(trace), 500.0, 1e-9);
  for (auto& row : trace.samples) {
    row.sample.has_stiffness = false;
  }
  EXPECT_TRUE(std::isnan(stiffest_N_per_m(trace)));
}

// On a spring the tangent is the reference. What is held lags by 1 to 2 periods of the simulator,
// 1.5 on average, so that its error is about 2 sin(w 1.5 T / 2) of the force's RMS.
TEST(JudgeOnPath, FindsTheErrorsThatASpringGives) {
  const evaluation::Trace trace = spring_trace();
  TuningRow tangent = setting("tangent");
  judge_on_path(trace, base(), tangent);
  EXPECT_EQ(tangent.problem, "");
  EXPECT_LT(tangent.path_error_percent, 1e-6);
  EXPECT_GT(tangent.method_us, 0.0);
  EXPECT_FALSE(tangent.measured);
  TuningRow hold = setting("hold");
  judge_on_path(trace, base(), hold);
  const double lag_percent = 200.0 * std::sin(0.5 * kMotion_rad_per_s * 1.5 / 30.0);
  EXPECT_NEAR(hold.path_error_percent, lag_percent, 0.1 * lag_percent);
}

TEST(JudgeOnPath, SaysWhichMethodsNoPathCanJudge) {
  const evaluation::Trace trace = spring_trace();
  TuningRow asking = setting("forcegrid+request");
  judge_on_path(trace, base(), asking);
  EXPECT_THAT(asking.problem, HasSubstr("positions that it chooses"));
  TuningRow unknown = setting("nosuch");
  judge_on_path(trace, base(), unknown);
  EXPECT_THAT(unknown.problem, HasSubstr("nosuch"));
}

TEST(StabilityMargin, IsThatOfTheTheoryAndFallsAsThePathGetsStiffer) {
  MarginLoop loop{.hand = "light", .stiffest_N_per_m = 100.0};
  const double tangent = stability_margin(loop, base(), setting("tangent"));
  const double hold = stability_margin(loop, base(), setting("hold"));
  // A force that does not follow the tool is stable up to about b / age, within a factor of two: b
  // of the light hand and the device is 2.8 N s/m, the age 1 to 2 periods of 33 ms.
  const double theory = 2.8 / (1.5 / 30.0) / loop.stiffest_N_per_m;
  EXPECT_GT(hold, 0.5 * theory);
  EXPECT_LT(hold, 2.0 * theory);
  EXPECT_GT(tangent, 5.0 * hold);  // it follows the tool
  loop.stiffest_N_per_m = 200.0;
  EXPECT_NEAR(stability_margin(loop, base(), setting("hold")), 0.5 * hold, 1e-12);
  EXPECT_THROW(
      stability_margin({.hand = "nobody", .stiffest_N_per_m = 1.0}, base(), setting("hold")),
      std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::tools
