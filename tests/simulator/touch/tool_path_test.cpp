// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/tool_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <numbers>
#include <random>

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 2e-3;
constexpr double kCount_m = 23e-6;
constexpr double kRounding_m = 1e-12;

double in_counts(double position_m) { return kCount_m * std::round(position_m / kCount_m); }

double end_speed_m_per_s(const ToolPath& path, double end_s) {
  constexpr double kStep_s = 1e-4;
  return (path.at(end_s).z() - path.at(end_s - kStep_s).z()) / kStep_s;
}

TEST(ToolPath, ASteadyAccelerationIsItselfWhateverTheSpacingUpToTheEnd) {
  const Vector3d speed_W(0.05, -0.02, 0.1);
  const Vector3d acceleration_W(1.0, 2.0, -3.0);
  const auto reference_W = [&](double t_s) {
    return Vector3d(0.5 * t_s * t_s * acceleration_W + t_s * speed_W + Vector3d(0.01, 0.02, 0.03));
  };
  std::mt19937 random(7);
  std::uniform_real_distribution<double> spacing_s(0.5e-3, 3e-3);
  ToolPath path;
  double end_s = 0.0;
  for (double t_s = 0.0; t_s < 0.2; t_s += spacing_s(random)) {
    path.add(t_s, reference_W(t_s));
    end_s = t_s;
  }
  for (double t_s = 0.03; t_s <= end_s; t_s += 0.37e-3) {
    EXPECT_LT((path.at(t_s) - reference_W(t_s)).norm(), kRounding_m) << t_s;
  }
  EXPECT_LT((path.at(end_s) - reference_W(end_s)).norm(), kRounding_m);
}

TEST(ToolPath, OfTheCountsLittleIsLeftInTheSpeedAtTheEnd) {
  constexpr double kSpeed_m_per_s = 0.0173;
  ToolPath path;
  double squares = 0.0;
  double raw_squares = 0.0;
  int judged = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t_s = kCycle_s * i;
    // Not in step with the counts.
    const double position_m = kSpeed_m_per_s * t_s + 1e-3 * std::sin(3.0 * t_s);
    const double speed_m_per_s = kSpeed_m_per_s + 3e-3 * std::cos(3.0 * t_s);
    path.add(t_s, {0, 0, in_counts(position_m)});
    path.forget_before(t_s - kCycle_s);
    if (t_s > ToolPath::kWindow_s) {
      const double before_m = position_m - kCycle_s * speed_m_per_s;
      const double raw = (in_counts(position_m) - in_counts(before_m)) / kCycle_s;
      squares += std::pow(end_speed_m_per_s(path, t_s) - speed_m_per_s, 2);
      raw_squares += std::pow(raw - speed_m_per_s, 2);
      ++judged;
    }
  }
  // Counts of q are noise of q / sqrt(12), in N = window / cycle + 1 positions.
  const double n = ToolPath::kWindow_s / kCycle_s + 1.0;
  const double expected = kCount_m / std::sqrt(12.0) * std::sqrt(192.0 / (n * n * n)) / kCycle_s;
  EXPECT_LT(std::sqrt(squares / judged), 1.3 * expected);
  EXPECT_GT(std::sqrt(raw_squares / judged), 3.0 * expected);
}

TEST(ToolPath, OfASineAsMuchIsWrongInTheSpeedAtTheEndAsASavitzkyGolayFilterOfThatWindowTells) {
  constexpr double kOmega_rad_per_s = 2.0 * std::numbers::pi * 3.0;
  constexpr double kAmplitude_m = 5e-3;
  constexpr double kFine_s = 0.25e-3;
  ToolPath path;
  double worst = 0.0;
  for (int i = 0; i < 4000; ++i) {
    const double t_s = kFine_s * i;
    path.add(t_s, {0, 0, kAmplitude_m * std::sin(kOmega_rad_per_s * t_s)});
    if (t_s > ToolPath::kWindow_s) {
      const double speed = kAmplitude_m * kOmega_rad_per_s * std::cos(kOmega_rad_per_s * t_s);
      worst = std::max(worst, std::abs(end_speed_m_per_s(path, t_s) - speed));
    }
  }
  const double share = std::pow(kOmega_rad_per_s * ToolPath::kWindow_s, 2) / 10.0;
  EXPECT_NEAR(worst, share * kAmplitude_m * kOmega_rad_per_s,
              0.25 * share * kAmplitude_m * kOmega_rad_per_s)
      << "terms of higher order, and a difference in place of a derivative";
}

TEST(ToolPath, IsStraightWherePositionsAreScarce) {
  ToolPath path;
  for (const double t_s : {0.0, 0.03, 0.06}) {
    path.add(t_s, {0, 0, t_s * t_s});
  }
  EXPECT_NEAR(path.at(0.045).z(), 0.5 * (0.03 * 0.03 + 0.06 * 0.06), kRounding_m);
  EXPECT_EQ(path.at(0.06).z(), 0.06 * 0.06);
  // A pause within a window that is well filled otherwise.
  path.clear();
  for (int i = 0; i <= 20; ++i) {
    path.add(kCycle_s * i, {0, 0, 0.1 * kCycle_s * i});
  }
  const double resumes_s = 20 * kCycle_s + 0.6 * ToolPath::kWindow_s;
  path.add(resumes_s, {0, 0, 0.0});
  EXPECT_EQ(path.at(resumes_s).z(), 0.0) << "not what those before the pause lead to";
}

TEST(ToolPath, EndsWhereItsPositionsEndAndBeginsAnewWhenTimeGoesBack) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  ToolPath path;
  EXPECT_TRUE(path.empty());
  path.add(kNaN, {0, 0, 0});
  path.add(1.0, {0, kNaN, 0});
  EXPECT_TRUE(path.empty());
  path.add(1.0, {0, 0, 1.0});
  path.add(2.0, {0, 0, 3.0});
  path.add(2.0, {0, 0, 7.0});
  EXPECT_EQ(path.at(0.0).z(), 1.0);
  EXPECT_EQ(path.at(9.0).z(), 3.0);
  path.add(1.5, {0, 0, 5.0});
  EXPECT_EQ(path.at(1.0).z(), 5.0);
  EXPECT_EQ(path.at(2.0).z(), 5.0);
}

TEST(ToolPath, ForgettingWhatIsPastChangesNothingFromThenOn) {
  ToolPath whole;
  ToolPath pruned;
  for (int i = 0; i < 300; ++i) {
    const double t_s = kCycle_s * i;
    const Vector3d position_W(0, in_counts(1e-3 * std::sin(20.0 * t_s)), in_counts(0.02 * t_s));
    whole.add(t_s, position_W);
    pruned.add(t_s, position_W);
    if (i % 17 == 0) {
      pruned.forget_before(t_s);
    }
    EXPECT_EQ(pruned.at(t_s), whole.at(t_s));
    const double earlier_s = kCycle_s * (i / 17 * 17) + 1e-4;
    EXPECT_EQ(pruned.at(earlier_s), whole.at(earlier_s));
  }
}

}  // namespace
}  // namespace forcegrid::simulator
