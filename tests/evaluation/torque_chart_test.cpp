// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/torque_chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "evaluation/files/error.h"

namespace forcegrid::evaluation {
namespace {

using ::testing::HasSubstr;

constexpr double kDuration_s = 1.5;
constexpr auto kHeld = static_cast<std::size_t>(TorqueWay::kHeld);
constexpr auto kLever = static_cast<std::size_t>(TorqueWay::kLever);
constexpr auto kStiffness = static_cast<std::size_t>(TorqueWay::kStiffness);
constexpr auto kGradient = static_cast<std::size_t>(TorqueWay::kGradient);

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

TorqueChartOptions short_options() {
  TorqueChartOptions options;
  options.seconds = kDuration_s;
  options.motions = {"twist", "random"};
  return options;
}

/// Solved once for all tests.
const std::vector<TorqueRow>& rows() {
  static const std::vector<TorqueRow> solved = measure_torques(short_options());
  return solved;
}

TEST(TwistMotion, BeginsAtTheGraspAndTurnsByWhatItSays) {
  for (const std::string& name : twist_motion_names()) {
    const TwistPose first = TwistMotion(name).pose(0.0);
    EXPECT_EQ(first.displacement_W, Eigen::Vector3d::Zero()) << name;
    EXPECT_EQ(first.turn_W.angularDistance(Eigen::Quaterniond::Identity()), 0.0) << name;
  }
  // At 5 s the twist has its whole size; phi = 2 pi (0.2 * 5 + 0.1 * 25), half a turn.
  const TwistPose late = TwistMotion("twist").pose(5.1);
  const double phase_rad = 2.0 * M_PI * (0.2 * 5.1 + 0.1 * 5.1 * 5.1);
  EXPECT_NEAR(late.turn_W.angularDistance(Eigen::Quaterniond::Identity()),
              std::abs(0.5 * std::sin(phase_rad)), 1e-8);
  EXPECT_NEAR(late.displacement_W.z(), 0.005, 1e-8);
  const TwistPose again = TwistMotion("random", 3).pose(2.0);
  EXPECT_EQ(again.displacement_W, TwistMotion("random", 3).pose(2.0).displacement_W);
  EXPECT_NE(again.displacement_W, TwistMotion("random", 4).pose(2.0).displacement_W);
}

TEST(TwistMotion, NamesTheKnownOnesForAnUnknownOne) {
  EXPECT_THAT([] { TwistMotion("wriggle"); },
              ::testing::ThrowsMessage<ChartError>(HasSubstr("twist, wring, tilt, random")));
}

TEST(TorqueChart, WhatIsHeldIsTheExactTorqueOfTheSamplesTime) {
  const TorqueRow& row = rows().front();
  ASSERT_EQ(row.instants.size(), static_cast<std::size_t>(kDuration_s * 500.0));
  double squared = 0.0;
  std::size_t count = 0;
  for (const TorqueInstant& instant : row.instants) {
    // The newest tick whose answer has come is a period old; it was taken at the cycle at or after
    // it.
    const double tick = std::floor(instant.time_s * 30.0 - 1.0 - 1e-9);
    if (tick < 1.0) {
      continue;
    }
    const auto then = static_cast<std::size_t>(std::ceil(tick / 30.0 * 500.0 - 1e-9));
    // The answer of a tick that lies between cycles comes as much later.
    if (row.instants[then].time_s + 1.0 / 30.0 > instant.time_s + 1e-9) {
      continue;
    }
    squared += (instant.rendered_W_Nm[kHeld] - row.instants[then].exact_W_Nm).squaredNorm();
    ++count;
  }
  ASSERT_GT(count, 500U);
  EXPECT_LT(std::sqrt(squared / static_cast<double>(count)), 2e-3 * row.torque_rms_Nm)
      << "the simulator's tolerance is 1e-3 of the force";
}

TEST(TorqueChart, ErrorsAreThoseOfTheCyclesAfterTheFirstSecond) {
  for (const TorqueRow& row : rows()) {
    double squared = 0.0;
    double exact_squared = 0.0;
    double largest_Nm = 0.0;
    int count = 0;
    for (const TorqueInstant& instant : row.instants) {
      if (instant.time_s >= 1.0) {
        const double error_Nm = (instant.rendered_W_Nm[kStiffness] - instant.exact_W_Nm).norm();
        squared += error_Nm * error_Nm;
        exact_squared += instant.exact_W_Nm.squaredNorm();
        largest_Nm = std::max(largest_Nm, error_Nm);
        ++count;
      }
    }
    EXPECT_EQ(count, 250);
    const double exact_rms_Nm = std::sqrt(exact_squared / count);
    EXPECT_NEAR(row.torque_rms_Nm, exact_rms_Nm, 1e-12);
    EXPECT_NEAR(row.rms_error_percent[kStiffness],
                100.0 * std::sqrt(squared / count) / exact_rms_Nm, 1e-9);
    EXPECT_NEAR(row.max_error_percent[kStiffness], 100.0 * largest_Nm / exact_rms_Nm, 1e-9);
  }
}

TEST(TorqueChart, TheStiffnessBeatsTheHeldTorqueAndALeverArmCannotTwist) {
  const TorqueRow& twist = rows().front();
  EXPECT_LT(twist.rms_error_percent[kStiffness], 0.25 * twist.rms_error_percent[kHeld]);
  EXPECT_GT(twist.rms_error_percent[kLever], 90.0) << "a twist about the force has no lever arm";
}

TEST(TorqueChart, TheGradientFollowsTheHandsWayToo) {
  const TorqueRow& random = rows().back();
  EXPECT_LT(random.rms_error_percent[kGradient], 0.5 * random.rms_error_percent[kStiffness]);
}

TEST(TorqueChart, WritesItsRowsEveryCycleAndThePicture) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "torque_chart" / "deep";
  std::filesystem::remove_all(folder);
  const auto files = write_torque_chart(folder, short_options(), rows());
  ASSERT_EQ(files.size(), 4U);
  const auto json = nlohmann::json::parse(text_of(files[0]));
  EXPECT_EQ(json.at("simulator_rate_Hz"), 30.0);
  ASSERT_EQ(json.at("rows").size(), 2U);
  EXPECT_EQ(json.at("rows")[0].at("stiffness_error_rms_percent"),
            rows()[0].rms_error_percent[kStiffness]);
  const std::string csv = text_of(files[1]);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 751);
  EXPECT_THAT(csv, HasSubstr("exact_z_W_Nm,held_x_W_Nm"));
  EXPECT_THAT(text_of(files[3]), HasSubstr("</svg>"));
}

TEST(TorqueChart, RefusesWhatCannotBeMeasured) {
  TorqueChartOptions options = short_options();
  options.seconds = 1.0;
  EXPECT_THROW(measure_torques(options), ChartError);
  options = short_options();
  options.simulator_rate_Hz = 0.0;
  EXPECT_THROW(measure_torques(options), ChartError);
  options = short_options();
  options.method = "wishful";
  EXPECT_THROW(measure_torques(options), std::invalid_argument);
  EXPECT_THROW(write_torque_chart(::testing::TempDir(), short_options(), {}), ChartError);
}

}  // namespace
}  // namespace forcegrid::evaluation
