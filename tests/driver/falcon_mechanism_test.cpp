// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <nlohmann/json.hpp>
#include <random>

#include "driver/delta_kinematics.h"
#include "driver/device.h"
#include "driver/force_limiter.h"
#include "driver/kinematics_json.h"
#include "driver/mechanism.h"
#include "falcon_sheet.h"

namespace forcegrid::driver {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using nlohmann::json;
using testing::HasSubstr;

class FalconMechanism : public testing::Test {
 protected:
  const profiles::DeviceProfile profile_ = profiles::load_device_profile("falcon");
  const std::unique_ptr<Mechanism> mechanism_ = make_mechanism(profile_);
};

TEST_F(FalconMechanism, HasTheSheetsGeometryInItsProfile) {
  const profiles::DeviceProfile::Delta sheet = falcon_sheet_geometry();
  const profiles::DeviceProfile::Delta& delta = profile_.delta;
  EXPECT_EQ(delta.thigh_m, sheet.thigh_m);
  EXPECT_EQ(delta.shin_m, sheet.shin_m);
  EXPECT_EQ(delta.platform_offset_u_m, sheet.platform_offset_u_m);
  EXPECT_EQ(delta.knee_end_m, sheet.knee_end_m);
  EXPECT_EQ(delta.platform_end_m, sheet.platform_end_m);
  EXPECT_EQ(delta.platform_offset_v_m, sheet.platform_offset_v_m);
  EXPECT_EQ(delta.base_offset_u_m, sheet.base_offset_u_m);
  EXPECT_EQ(delta.base_offset_v_m, sheet.base_offset_v_m);
  for (std::size_t leg = 0; leg < 3; ++leg) {
    EXPECT_NEAR(delta.leg_azimuth_rad[leg], sheet.leg_azimuth_rad[leg], 1e-15);
  }
  EXPECT_NEAR(delta.encoder_rad_per_count, 6.359047629780477e-4, 1e-18);
  EXPECT_NEAR(delta.zero_angle_rad, sheet.zero_angle_rad, 1e-15);
  EXPECT_EQ(profile_.falcon.torque_gain_per_Nm, 10000.0);
  EXPECT_EQ(profile_.falcon.command_limit, 4095);
}

TEST_F(FalconMechanism, ShowsTheTipInTheDeviceFrame) {
  // The sheet's base frame: x right, y up, z toward the user. Device frame: x toward the user,
  // y right, z up, from the centre.
  const Vector3d position_B(0.008943261911, -0.006036252787, 0.112189283513);
  const ArmPose pose = mechanism_->forward({-300, -650, -420, 7, 8, 9});
  ASSERT_EQ(pose.status, KinematicsStatus::kOk);
  const profiles::Axes& center = profile_.delta.center_m;
  EXPECT_NEAR(pose.position_D.x(), position_B.z() - center[2], 1.5e-12);
  EXPECT_NEAR(pose.position_D.y(), position_B.x() - center[0], 1.5e-12);
  EXPECT_NEAR(pose.position_D.z(), position_B.y() - center[1], 1.5e-12);
  EXPECT_NEAR(pose.joint_angle_rad[1], 0.197527142262, 1.5e-12);
}

TEST_F(FalconMechanism, HasTheTorquesOfTheSheetForTheSameForce) {
  // At (0.02, -0.01, 0.12) m in the base frame; (1.5, -2, 0.75) N there is (0.75, 1.5, -2) in D.
  const ArmPose pose = mechanism_->forward({16, -645, -128, 0, 0, 0});
  const Vector3d torque_Nm = pose.jacobian_D.transpose() * Vector3d(0.75, 1.5, -2.0);
  EXPECT_NEAR(torque_Nm[0], 0.166612722942, 2e-4);  // the counts are rounded
  EXPECT_NEAR(torque_Nm[1], -0.068462352799, 2e-4);
  EXPECT_NEAR(torque_Nm[2], -0.012788825604, 2e-4);
}

TEST_F(FalconMechanism, PushesWhereTheJacobianSays) {
  // Power at the joints is power at the tip, with the velocity from two poses.
  constexpr unsigned kSeed = 4401;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<int> count(-500, 400);
  std::uniform_int_distribution<int> step(-2, 2);
  std::uniform_real_distribution<double> newton(-5.0, 5.0);
  for (int i = 0; i < 200; ++i) {
    const std::array<std::int32_t, 6> counts = {count(random), count(random), count(random)};
    auto before = counts, after = counts;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int change = step(random);
      before[axis] -= change;
      after[axis] += change;
    }
    const ArmPose pose = mechanism_->forward(counts);
    if (pose.status != KinematicsStatus::kOk) {
      continue;
    }
    const ArmPose from = mechanism_->forward(before), to = mechanism_->forward(after);
    const Vector3d force_D(newton(random), newton(random), newton(random));
    const Vector3d torque_Nm = pose.jacobian_D.transpose() * force_D;
    EXPECT_NEAR(torque_Nm.dot(to.joint_angle_rad - from.joint_angle_rad),
                force_D.dot(to.position_D - from.position_D), 2e-7);
  }
}

TEST_F(FalconMechanism, SaysThatImpossibleCountsAreOutOfRange) {
  for (const std::array<std::int32_t, 6>& counts :
       {std::array<std::int32_t, 6>{32767, -32768, 0}, std::array<std::int32_t, 6>{-3000, 3000, 0},
        std::array<std::int32_t, 6>{1800, 1800, 1800}}) {
    const ArmPose pose = mechanism_->forward(counts);
    EXPECT_TRUE(pose.status == KinematicsStatus::kOutOfRange ||
                pose.status == KinematicsStatus::kSingular)
        << to_string(pose.status);
  }
  EXPECT_EQ(mechanism_->forward({-3000, 3000, 0}).status, KinematicsStatus::kOutOfRange);
  // and finds back afterwards
  EXPECT_EQ(mechanism_->forward({0, 0, 0}).status, KinematicsStatus::kOk);
  EXPECT_NEAR(mechanism_->forward({0, 0, 0}).position_D.x(),
              0.134602428444 - profile_.delta.center_m[2], 1.5e-12);
}

TEST_F(FalconMechanism, LimitsTorquesToTheLargestCommandAndKeepsTheDirection) {
  ForceLimiter limiter(profile_);
  const ArmPose pose = mechanism_->forward({-300, -650, -420, 0, 0, 0});
  const Vector3d wanted_D(5.0, -4.0, 4.5);
  const LimitedForce limited = limiter.apply(wanted_D, pose, 1000.0);
  EXPECT_EQ(limited.current_A, (std::array<double, 3>{}));
  EXPECT_LE(limited.joint_torque_Nm.cwiseAbs().maxCoeff(), 0.4095 * (1.0 + 1e-12));
  const Vector3d felt_D = pose.jacobian_D.transpose().inverse() * limited.joint_torque_Nm;
  EXPECT_LT(felt_D.normalized().cross(wanted_D.normalized()).norm(), 1e-9);
  EXPECT_GT(felt_D.dot(wanted_D), 0.0);
}

TEST_F(FalconMechanism, LimitsTorquesToTheCommandEvenIfTheProfileAllowsMore) {
  profiles::DeviceProfile generous = profile_;
  generous.limits.max_joint_torque_Nm = {9.0, 9.0, 9.0};
  generous.limits.max_force_N = 1000.0;
  generous.limits.max_force_rate_N_per_s = 1e9;
  ForceLimiter limiter(generous);
  const ArmPose pose = mechanism_->forward({-300, -650, -420, 0, 0, 0});
  const LimitedForce limited = limiter.apply(Vector3d(0.0, 0.0, 100.0), pose, 1.0);
  EXPECT_TRUE(limited.acted & kLimitTorque);
  EXPECT_NEAR(limited.joint_torque_Nm.cwiseAbs().maxCoeff(), 0.4095, 1e-12);
}

// --- forcegrid kinematics ---

TEST_F(FalconMechanism, PrintsTheSheetsCommandsForAPosition) {
  const json result =
      json::parse(kinematics_json_from_position(profile_, {-0.02, -0.035, 0.15}, {2.5, 1.0, -0.5}));
  EXPECT_EQ(result.at("profile"), "falcon");
  EXPECT_EQ(result.at("frame"), "base");
  EXPECT_EQ(result.at("command"), (json{-120, 1620, -1149}));
  EXPECT_EQ(result.at("command_scaled"), false);
  const double torque_Nm[] = {0.012081616571, -0.162085114692, 0.114963619770};
  const double counts[] = {907.80866492, 733.31148794, -98.57649047};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(result.at("joint_torque_Nm")[i].get<double>(), torque_Nm[i], 1.5e-12);
    EXPECT_NEAR(result.at("counts")[i].get<double>(), counts[i], 1.5e-8);
  }
  EXPECT_FALSE(result.contains("current_A"));
}

TEST_F(FalconMechanism, PrintsTheSheetsPositionForCounts) {
  const json result = json::parse(kinematics_json_from_counts(profile_, {456, -998, -29}));
  const double position_m[] = {0.037290229198, -0.028302454267, 0.114221603622};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(result.at("position_m")[i].get<double>(), position_m[i], 1.5e-12);
  }
  EXPECT_EQ(result.at("status"), "ok");
  EXPECT_EQ(result.at("command"), (json{0, 0, 0}));
}

TEST_F(FalconMechanism, ScalesThePrintedCommandsOfATooLargeForce) {
  const json result =
      json::parse(kinematics_json_from_position(profile_, {0.0, 0.0, 0.11}, {80.0, 0.0, 0.0}));
  EXPECT_EQ(result.at("command_scaled"), true);
  EXPECT_EQ(result.at("command")[1], 4095);  // the sheet's largest, 527 a newton
}

std::string complaint_of(const std::function<std::string()>& call) {
  try {
    return "no complaint: " + call();
  } catch (const DeviceError& error) {
    return error.what();
  }
}

TEST_F(FalconMechanism, ExplainsWhatItCantPrint) {
  EXPECT_THAT(complaint_of([&] {
                return kinematics_json_from_position(profile_, {0.0, 0.0, 0.2});
              }),
              HasSubstr("out of reach of profile 'falcon'"));
  EXPECT_THAT(complaint_of([&] {
                return kinematics_json_from_counts(profile_, {-3000.0, 3000.0, 0.0});
              }),
              HasSubstr("no pose of profile 'falcon' has them"));
}

}  // namespace
}  // namespace forcegrid::driver
