// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/wrist.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "device_emulator/operator_script.h"
#include "device_emulator/wrist_motion.h"

namespace forcegrid::emulator {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using std::chrono::milliseconds;

constexpr double kRounding = 1e-12;

profiles::DeviceProfile wrist_profile() {
  return profiles::load_device_profile("woodenhaptics_v2015_wrist");
}

profiles::DeviceProfile phantom_profile() {
  return profiles::load_device_profile("phantom_desktop_wrist");
}

TEST(Wrist, IsTheSheetsProductOfEigensRotations) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  const Wrist wrist(wrist_profile().gimbal);
  const Wrist phantom(phantom_profile().gimbal);
  for (int trial = 0; trial < 500; ++trial) {
    const Vector3d theta(angle(random), angle(random), angle(random));
    const Vector3d g(angle(random), angle(random), angle(random));
    const Matrix3d expected =
        (AngleAxisd(theta[0], Vector3d::UnitZ()) *
         AngleAxisd(0.5 * std::numbers::pi - theta[2], Vector3d::UnitY()) *
         AngleAxisd(g[0], Vector3d::UnitX()) * AngleAxisd(g[1], Vector3d::UnitY()) *
         AngleAxisd(g[2], Vector3d::UnitX()))
            .toRotationMatrix();
    EXPECT_LT((wrist.tool_axes_D(theta, g) - expected).norm(), kRounding);
    EXPECT_LT((phantom.tool_axes_D(theta, g) - expected).norm(), kRounding) << "same axes";
  }
}

TEST(Wrist, CountsEachJointOnTheSheetsCounter) {
  const Wrist wrist(wrist_profile().gimbal);
  // A quarter turn is 256 counts; joints D, E, F are counters f, e, d.
  const double quarter = 0.5 * std::numbers::pi;
  EXPECT_EQ(wrist.encoder_positions({quarter, 0.0, 0.0}), (std::array<std::int64_t, 3>{0, 0, 256}));
  EXPECT_EQ(wrist.encoder_positions({0.0, -quarter, 0.0}),
            (std::array<std::int64_t, 3>{0, -256, 0}));
  EXPECT_EQ(wrist.encoder_positions({0.0, 0.0, 0.5 * quarter}),
            (std::array<std::int64_t, 3>{128, 0, 0}));
  EXPECT_NEAR((wrist.joint_angle_rad({0, 0, 0, 128, -256, 256}) -
               Vector3d(quarter, -quarter, 0.5 * quarter))
                  .norm(),
              0.0, kRounding);
}

TEST(Wrist, OfThePhantomCountsTheStepsOfItsConverters) {
  const Wrist wrist(phantom_profile().gimbal);
  const double quarter = 0.5 * std::numbers::pi;
  // Level; yaw and roll by half a turn would be 635 and 615.5 steps.
  EXPECT_EQ(wrist.encoder_positions({0.4 * quarter, -quarter, -0.4 * quarter}),
            (std::array<std::int64_t, 3>{127, -653, -123}));
  EXPECT_NEAR(
      (wrist.joint_angle_rad({0, 0, 0, 127, -653, 0}) - Vector3d(0.4 * quarter, -quarter, 0.0))
          .norm(),
      0.0, kRounding);
  // The stylus does not bend back beyond the forearm's line.
  EXPECT_EQ(wrist.within_stops({3.0, 0.2, -3.0}), Vector3d(2.55, 0.0, -2.61));
}

TEST(Wrist, OfAnArmWithoutOneKeepsTheAxesOfDAndCountsNothing) {
  const Wrist none(profiles::load_device_profile("polhem_v1").gimbal);
  EXPECT_FALSE(none.present());
  EXPECT_EQ(none.tool_axes_D({0.1, 0.2, 0.3}, {1.0, 1.0, 1.0}), Matrix3d::Identity());
  EXPECT_EQ(none.encoder_positions({1.0, 1.0, 1.0}), (std::array<std::int64_t, 3>{}));
  EXPECT_EQ(none.joint_angle_rad({1, 2, 3, 4, 5, 6}), Vector3d::Zero());
}

TEST(WristMotion, StaysWithinTheStopsAndTurnsEveryJoint) {
  const auto options = OperatorScript::on_device({}, wrist_profile());
  const Wrist wrist(wrist_profile().gimbal);
  const WristMotion turn(WristMotionKind::kTurn, options.wrist_rest_rad, options.wrist_reach_rad,
                         {});
  EXPECT_EQ(turn.angle_rad(0.0), Vector3d::Zero());
  Vector3d largest = Vector3d::Zero();
  Vector3d last = turn.angle_rad(0.0);
  for (int ms = 0; ms <= 20000; ++ms) {
    const Vector3d angle = turn.angle_rad(1e-3 * ms);
    EXPECT_EQ(wrist.within_stops(angle), angle);
    EXPECT_LT((angle - last).norm(), 0.005) << "no faster than 5 rad/s";
    largest = largest.cwiseMax(angle.cwiseAbs());
    last = angle;
  }
  // A third of 2.6, 1.4 and 3.0 rad.
  EXPECT_NEAR((largest - Vector3d(2.6, 1.4, 3.0) / 3.0).norm(), 0.0, 1e-3);
}

TEST(WristMotion, OfAPhantomTurnsAboutTheLevelStylus) {
  const auto options = OperatorScript::on_device({}, phantom_profile());
  const Wrist wrist(phantom_profile().gimbal);
  const WristMotion turn(WristMotionKind::kTurn, options.wrist_rest_rad, options.wrist_reach_rad,
                         {});
  const Vector3d level_rad(0.0, -0.5 * std::numbers::pi, 0.0);
  EXPECT_NEAR((turn.angle_rad(0.0) - level_rad).norm(), 0.0, kRounding);
  Vector3d largest = Vector3d::Zero();
  for (int ms = 0; ms <= 20000; ++ms) {
    const Vector3d angle = turn.angle_rad(1e-3 * ms);
    EXPECT_EQ(wrist.within_stops(angle), angle);
    largest = largest.cwiseMax((angle - level_rad).cwiseAbs());
  }
  // A third of the way to the nearer stop: 2.51, 2.46 - pi/2 and 2.61 rad.
  EXPECT_NEAR((largest - Vector3d(2.51, 2.46 - 0.5 * std::numbers::pi, 2.61) / 3.0).norm(), 0.0,
              1e-3);
}

TEST(WristMotion, TwistsTheLastJointAlone) {
  const WristMotion twist(WristMotionKind::kTwist, Vector3d::Zero(), Vector3d::Ones(), {});
  EXPECT_NEAR((twist.angle_rad(5.0) - Vector3d(0.0, 0.0, 1.0)).norm(), 0.0, kRounding);
  EXPECT_NEAR((twist.angle_rad(7.0) - Vector3d(0.0, 0.0, -1.0)).norm(), 0.0, kRounding);
  EXPECT_THROW(parse_wrist_motion("spin"), std::invalid_argument);
  EXPECT_EQ(parse_wrist_motion("twist"), WristMotionKind::kTwist);
}

TEST(WristMotion, FollowsARecordedPathThatHasIt) {
  const std::vector<PathPoint> path{{1.0, Vector3d::Zero(), Vector3d(0.1, 0.2, 0.3)},
                                    {2.0, Vector3d::Zero(), Vector3d(0.3, 0.2, -0.3)}};
  const WristMotion motion(WristMotionKind::kTurn, Vector3d::Zero(), Vector3d::Ones(), path);
  EXPECT_EQ(motion.angle_rad(0.0), Vector3d(0.1, 0.2, 0.3));
  EXPECT_NEAR((motion.angle_rad(0.5) - Vector3d(0.2, 0.2, 0.0)).norm(), 0.0, kRounding);
  EXPECT_EQ(motion.angle_rad(9.0), Vector3d(0.3, 0.2, -0.3));
}

TEST(OperatorScript, TurnsTheWristFromAndToTheCalibrationPoseAndClicks) {
  OperatorScript::Options options = OperatorScript::on_device({}, wrist_profile());
  options.calibrated = true;
  options.wrist_rest_rad = Vector3d(0.1, 0.0, -0.2);
  options.click_every_s = 1.0;
  OperatorScript script(options, Vector3d::Zero());
  Vector3d last = options.wrist_rest_rad;
  int clicks = 0;
  bool down = false;
  bool turned = false;
  for (int ms = 0; ms < 12000; ++ms) {
    const auto action = script.update(rt::TimePoint(milliseconds(ms)), {.host_present = ms < 8000});
    EXPECT_LT((action.gimbal_rad - last).norm(), 0.02) << "at " << ms << " ms";
    last = action.gimbal_rad;
    turned = turned || (last - options.wrist_rest_rad).norm() > 0.3;
    clicks += action.stylus_pressed && !down ? 1 : 0;
    down = action.stylus_pressed;
    if (script.phase() != OperatorScript::Phase::kMoving) {
      EXPECT_FALSE(down);
    }
  }
  EXPECT_TRUE(turned);
  EXPECT_EQ(last, options.wrist_rest_rad) << "the host has gone";
  // The motion begins after 0.2 s, 1.2 s, 0.5 s and 0.5 s, and lasts until 8 s.
  EXPECT_EQ(clicks, 5);
}

}  // namespace
}  // namespace forcegrid::emulator
