// SPDX-License-Identifier: Apache-2.0
#include "driver/force_limiter.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

namespace forcegrid::driver {
namespace {

using Eigen::Vector3d;
using profiles::load_device_profile;

constexpr double kLong_s = 1000.0;  // the slew limit does not act within it

class Limiter : public testing::Test {
 protected:
  profiles::DeviceProfile profile_ = load_device_profile("woodenhaptics_v2015");
  ArmKinematics kinematics_{profile_};
  ForceLimiter limiter_{profile_};
  ArmPose pose_ = kinematics_.forward(Vector3d(1000, 2000, 6500));
};

TEST_F(Limiter, LetsAPermittedForceThroughToTheSheetsCurrents) {
  const LimitedForce limited = limiter_.apply(Vector3d(1, -2, 0.5), pose_, kLong_s);
  EXPECT_EQ(limited.acted, 0);
  EXPECT_EQ(limited.force_D, Vector3d(1, -2, 0.5));
  EXPECT_NEAR(limited.joint_torque_Nm[0], -0.744919276239, 1e-12);
  EXPECT_NEAR(limited.current_A[0], -1.797585126060, 1e-12);
  EXPECT_NEAR(limited.current_A[1], 0.172468200873, 1e-12);
  EXPECT_NEAR(limited.current_A[2], 0.330003535446, 1e-12);
}

TEST_F(Limiter, ShortensAForceAlongItsDirection) {
  const Vector3d wanted_D(30, -40, 120);
  const LimitedForce limited = limiter_.apply(wanted_D, pose_, kLong_s);
  EXPECT_TRUE(limited.acted & kLimitForce);
  EXPECT_NEAR(limited.force_D.norm(), profile_.limits.max_force_N, 1e-12);
  EXPECT_LT(limited.force_D.normalized().cross(wanted_D.normalized()).norm(), 1e-12);
  EXPECT_GT(limited.force_D.dot(wanted_D), 0.0);
}

TEST_F(Limiter, SurvivesTheLargestFiniteForce) {
  constexpr double kHuge = std::numeric_limits<double>::max();
  const LimitedForce limited = limiter_.apply(Vector3d(kHuge, kHuge, -kHuge), pose_, kLong_s);
  EXPECT_NEAR(limited.force_D.norm(), profile_.limits.max_force_N, 1e-9);
}

TEST_F(Limiter, ChangesTheForceNoFasterThanTheSlewRate) {
  constexpr double kCycle_s = 0.002;
  const double step_N = profile_.limits.max_force_rate_N_per_s * kCycle_s;
  const Vector3d wanted_D(0, 3, -4);
  Vector3d last_D = Vector3d::Zero();
  int cycles = 0;
  for (LimitedForce limited = limiter_.apply(wanted_D, pose_, kCycle_s);;
       limited = limiter_.apply(wanted_D, pose_, kCycle_s)) {
    EXPECT_LE((limited.force_D - last_D).norm(), step_N * (1 + 1e-12));
    last_D = limited.force_D;
    ++cycles;
    if ((limited.acted & kLimitSlew) == 0) {
      break;
    }
    ASSERT_LT(cycles, 100);
  }
  EXPECT_LT((last_D - wanted_D).norm(), 1e-12);
  EXPECT_EQ(cycles, static_cast<int>(std::ceil(5.0 / step_N)));
}

TEST_F(Limiter, AllowsNoChangeInNoTime) {
  const LimitedForce limited = limiter_.apply(Vector3d(1, 1, 1), pose_, 0.0);
  EXPECT_EQ(limited.force_D, Vector3d::Zero());
  EXPECT_TRUE(limited.acted & kLimitSlew);
  EXPECT_EQ(limiter_.apply(Vector3d(1, 1, 1), pose_, -1.0).force_D, Vector3d::Zero());
}

TEST_F(Limiter, AnswersNanWithZeroAndGrowsFromZeroAfterwards) {
  static_cast<void>(limiter_.apply(Vector3d(3, 0, 0), pose_, kLong_s));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  ArmPose bad_pose = pose_;
  bad_pose.jacobian_D(1, 1) = kNan;
  const auto expect_zero = [](const LimitedForce& limited) {
    EXPECT_EQ(limited.acted, kLimitNotFinite);
    EXPECT_EQ(limited.force_D, Vector3d::Zero());
    EXPECT_EQ(limited.joint_torque_Nm, Vector3d::Zero());
    EXPECT_EQ(limited.current_A, (std::array<double, 3>{0, 0, 0}));
  };
  expect_zero(limiter_.apply(Vector3d(0, kNan, 0), pose_, kLong_s));
  expect_zero(limiter_.apply(Vector3d(0, kInfinity, 0), pose_, kLong_s));
  expect_zero(limiter_.apply(Vector3d(1, 0, 0), bad_pose, kLong_s));
  expect_zero(limiter_.apply(Vector3d(1, 0, 0), ArmPose{}, kLong_s));
  expect_zero(limiter_.apply(Vector3d(1, 0, 0), pose_, kNan));
  expect_zero(limiter_.apply(Vector3d(1, 0, 0), pose_, kLong_s, Vector3d(kNan, 0, 0)));
  const LimitedForce next = limiter_.apply(Vector3d(3, 0, 0), pose_, 0.001);
  EXPECT_NEAR(next.force_D.norm(), profile_.limits.max_force_rate_N_per_s * 0.001, 1e-12);
}

TEST_F(Limiter, ResetsToZero) {
  static_cast<void>(limiter_.apply(Vector3d(3, 0, 0), pose_, kLong_s));
  limiter_.reset();
  EXPECT_EQ(limiter_.apply(Vector3d(3, 0, 0), pose_, 0.0).force_D, Vector3d::Zero());
}

TEST_F(Limiter, ScalesAllJointsTogetherAtTheTorqueLimit) {
  auto profile = profile_;
  profile.limits.max_joint_torque_Nm = {0.1, 10.0, 10.0};
  ForceLimiter limiter(profile);
  const Vector3d force_D(1, -2, 0.5);
  const Vector3d full_Nm = ArmKinematics::joint_torque(pose_, force_D);
  const LimitedForce limited = limiter.apply(force_D, pose_, kLong_s);
  EXPECT_EQ(limited.acted, kLimitTorque);
  EXPECT_NEAR(std::abs(limited.joint_torque_Nm[0]), 0.1, 1e-12);
  EXPECT_LT(limited.joint_torque_Nm.normalized().cross(full_Nm.normalized()).norm(), 1e-12);
}

TEST_F(Limiter, ScalesAllMotorsTogetherAtTheCurrentLimit) {
  auto profile = profile_;
  profile.motors.max_current_A = {6.0, 0.05, 6.0};
  ForceLimiter limiter(profile);
  const LimitedForce limited = limiter.apply(Vector3d(1, -2, 0.5), pose_, kLong_s);
  EXPECT_EQ(limited.acted, kLimitCurrent);
  EXPECT_NEAR(limited.current_A[1], 0.05, 1e-12);
  EXPECT_NEAR(limited.current_A[0] / limited.current_A[1], -1.797585126060 / 0.172468200873, 1e-8);
  EXPECT_NEAR(limited.current_A[2] / limited.current_A[1], 0.330003535446 / 0.172468200873, 1e-8);
}

TEST_F(Limiter, AddsTheExtraTorqueBeforeTheTorqueLimit) {
  const Vector3d gravity_Nm = kinematics_.gravity_torque(pose_.joint_angle_rad);
  const LimitedForce limited = limiter_.apply(Vector3d::Zero(), pose_, kLong_s, gravity_Nm);
  EXPECT_EQ(limited.acted, 0);
  EXPECT_EQ(limited.joint_torque_Nm, gravity_Nm);
  const LimitedForce heavy = limiter_.apply(Vector3d::Zero(), pose_, kLong_s, Vector3d(0, 50, 0));
  EXPECT_TRUE(heavy.acted & kLimitTorque);
  EXPECT_LE(heavy.joint_torque_Nm[1], profile_.limits.max_joint_torque_Nm[1] * (1 + 1e-12));
}

TEST(ForceLimiter, KeepsEveryArmWithinItsLimitsForAnyForceAndPose) {
  constexpr unsigned kSeed = 77;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> force_N(-100.0, 100.0);
  std::uniform_real_distribution<double> angle_rad(-4.0, 4.0);
  for (const char* name :
       {"woodenhaptics_v2015", "woodenhaptics_v2019", "polhem_v1", "vintage", "phantom_desktop"}) {
    const auto profile = load_device_profile(name);
    const ArmKinematics kinematics(profile);
    ForceLimiter limiter(profile);
    for (int i = 0; i < 2000; ++i) {
      const ArmPose pose = kinematics.forward_from_angles(
          Vector3d(angle_rad(random), angle_rad(random), angle_rad(random)));
      const LimitedForce limited =
          limiter.apply(Vector3d(force_N(random), force_N(random), force_N(random)), pose, 0.002,
                        Vector3d(force_N(random), force_N(random), force_N(random)));
      ASSERT_LE(limited.force_D.norm(), profile.limits.max_force_N * (1 + 1e-12));
      for (std::size_t joint = 0; joint < 3; ++joint) {
        ASSERT_LE(std::abs(limited.joint_torque_Nm[static_cast<Eigen::Index>(joint)]),
                  profile.limits.max_joint_torque_Nm[joint] * (1 + 1e-12));
        ASSERT_LE(std::abs(limited.current_A[joint]), profile.motors.max_current_A[joint]);
      }
    }
  }
}

}  // namespace
}  // namespace forcegrid::driver
