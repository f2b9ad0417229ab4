// SPDX-License-Identifier: Apache-2.0
#include "driver/wrist_limiter.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "driver/mechanism.h"

namespace forcegrid::driver {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Counts = std::array<std::int32_t, 6>;

constexpr Counts kPose = {0, 0, 6000, 0, 0, 0};
constexpr double kAge_s = 1.0;  // enough for any torque: 20 N m/s

profiles::DeviceProfile profile() { return profiles::load_device_profile("emulated_6dof"); }
ArmPose pose_at(const Counts& counts) { return make_mechanism(profile())->forward(counts); }

Counts random_counts(std::mt19937& random) {
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const auto around = [&](double middle, double reach) {
    return static_cast<std::int32_t>(std::lround(middle + reach * any(random)));
  };
  return {around(0, 3000), around(1300, 800), around(4500, 1200),
          around(0, 700),  around(0, 600),    around(0, 1400)};
}

// Twist of the tool between two neighbouring counts over the angle between them: a column of J.
TEST(WristLimiter, HasTheJacobianOfThePosesFiniteDifferences) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto mechanism = make_mechanism(profile());
  for (int trial = 0; trial < 200; ++trial) {
    const Counts at = random_counts(random);
    const ArmPose pose = mechanism->forward(at);
    const Eigen::Matrix<double, 6, 6> jacobian = jacobian_6(pose);
    for (std::size_t i = 0; i < 6; ++i) {
      const double rad_per_count = 2.0 * std::numbers::pi /
                                   (i == 0  ? 32000.0
                                    : i < 3 ? 24000.0
                                            : 4096.0);
      Counts before = at;
      Counts after = at;
      --before[i];
      ++after[i];
      const ArmPose low = mechanism->forward(before);
      const ArmPose high = mechanism->forward(after);
      const Matrix3d skew = (high.rotation_DT - low.rotation_DT) * pose.rotation_DT.transpose() /
                            (2.0 * rad_per_count);
      Vector6 column;
      column << (high.position_D - low.position_D) / (2.0 * rad_per_count), skew(2, 1), skew(0, 2),
          skew(1, 0);
      // A step of 1.5 mrad leaves (1.5 mrad)^2 / 6.
      EXPECT_LT((jacobian.col(static_cast<Eigen::Index>(i)) - column).norm(), 1e-6)
          << "joint " << i;
    }
  }
}

// The power of a wrench at the tool is that of its torques at the joints, whatever moves.
TEST(WristLimiter, TorquesDoTheWorkOfTheWrench) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const auto vector = [&] { return Vector3d(any(random), any(random), any(random)); };
  for (int trial = 0; trial < 500; ++trial) {
    const ArmPose pose = pose_at(random_counts(random));
    const Vector3d force_D = 5.0 * vector();
    const Vector3d torque_D = 0.1 * vector();
    Vector6 speed;
    speed << vector(), vector();
    const Vector6 twist = jacobian_6(pose) * speed;
    EXPECT_NEAR(wrench_torques(pose, force_D, torque_D).dot(speed),
                force_D.dot(twist.head<3>()) + torque_D.dot(twist.tail<3>()), 1e-12);
  }
}

TEST(WristLimiter, TurnsATorqueIntoTheCurrentsOfTheProfile) {
  WristLimiter limiter(profile());
  ASSERT_TRUE(limiter.drives());
  // In the calibration pose the wrist's axes are z, y, x of D. 0.0163 N m/A behind 12 turns.
  const LimitedTorque limited = limiter.apply(Vector3d(0.01, -0.02, 0.03), pose_at(kPose), kAge_s);
  EXPECT_EQ(limited.acted, 0);
  constexpr double kTorquePerCurrent = 0.0163 * 12;
  EXPECT_NEAR(limited.current_A[0], 0.03 / kTorquePerCurrent, 1e-12);
  EXPECT_NEAR(limited.current_A[1], -0.02 / kTorquePerCurrent, 1e-12);
  EXPECT_NEAR(limited.current_A[2], 0.01 / kTorquePerCurrent, 1e-12);
  // The base a carries the torque about z, the elbow c the opposite of that about y.
  EXPECT_NEAR((limited.arm_torque_Nm - Vector3d(0.03, 0.0, 0.02)).norm(), 0.0, 1e-12);
}

TEST(WristLimiter, ShortensTheTorqueAndKeepsItsDirection) {
  WristLimiter limiter(profile());
  const Vector3d wanted_D(3.0, -4.0, 0.0);
  const LimitedTorque limited = limiter.apply(wanted_D, pose_at(kPose), kAge_s);
  EXPECT_EQ(limited.acted, kLimitForce);
  EXPECT_NEAR(limited.torque_D_Nm.norm(), 0.188, 1e-12);
  EXPECT_NEAR(limited.torque_D_Nm.normalized().dot(wanted_D.normalized()), 1.0, 1e-12);
}

TEST(WristLimiter, LimitsEachJointsTorqueAndCurrent) {
  profiles::DeviceProfile weak = profile();
  weak.gimbal_motors.max_joint_torque_Nm = {0.19, 0.05, 0.19};  // joint 2, about y
  WristLimiter limiter(weak);
  LimitedTorque limited = limiter.apply(Vector3d(0.02, 0.1, 0.0), pose_at(kPose), kAge_s);
  EXPECT_EQ(limited.acted, kLimitTorque);
  EXPECT_NEAR((limited.torque_D_Nm - Vector3d(0.01, 0.05, 0.0)).norm(), 0.0, 1e-12);
  weak.gimbal_motors.max_joint_torque_Nm = {1.0, 1.0, 1.0};
  weak.gimbal_motors.max_current_A = {1.0, 1.0, 0.1};  // joint 3, about x: 0.01956 N m
  WristLimiter other(weak);
  limited = other.apply(Vector3d(0.03912, 0.1, 0.0), pose_at(kPose), kAge_s);
  EXPECT_EQ(limited.acted, kLimitCurrent);
  EXPECT_NEAR((limited.torque_D_Nm - Vector3d(0.01956, 0.05, 0.0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR(limited.current_A[2], 0.1, 1e-12);
}

TEST(WristLimiter, LetsTheTorqueGrowAtItsRateFromZero) {
  WristLimiter limiter(profile());
  const Vector3d wanted_D(0.0, 0.1, 0.0);
  for (int i = 1; i <= 3; ++i) {  // 20 N m/s for a millisecond: 20 mN m
    const LimitedTorque limited = limiter.apply(wanted_D, pose_at(kPose), 1e-3);
    EXPECT_EQ(limited.acted, kLimitSlew);
    EXPECT_NEAR(limited.torque_D_Nm.y(), 0.02 * i, 1e-12);
  }
  limiter.reset();
  EXPECT_NEAR(limiter.apply(wanted_D, pose_at(kPose), 1e-3).torque_D_Nm.y(), 0.02, 1e-12);
  EXPECT_EQ(limiter.apply(wanted_D, pose_at(kPose), 0.0).torque_D_Nm.y(), 0.02);
}

TEST(WristLimiter, GivesZeroForWhatIsNotFiniteOrHasNoMotors) {
  WristLimiter limiter(profile());
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    const LimitedTorque limited = limiter.apply(Vector3d(0.0, bad, 0.1), pose_at(kPose), kAge_s);
    EXPECT_EQ(limited.acted, kLimitNotFinite);
    EXPECT_EQ(limited.current_A, (std::array<double, 3>{}));
    EXPECT_EQ(limited.arm_torque_Nm, Vector3d::Zero());
  }
  EXPECT_EQ(limiter.apply(Vector3d(0.0, 0.0, 0.1), ArmPose(), kAge_s).acted, kLimitNotFinite);
  for (const char* name : {"woodenhaptics_v2015", "woodenhaptics_v2015_wrist", "falcon"}) {
    WristLimiter none(profiles::load_device_profile(name));
    EXPECT_FALSE(none.drives()) << name;
    const LimitedTorque limited = none.apply(Vector3d(0.0, 0.0, 0.1), pose_at(kPose), kAge_s);
    EXPECT_EQ(limited.acted, 0) << name;
    EXPECT_EQ(limited.current_A, (std::array<double, 3>{})) << name;
    EXPECT_EQ(limited.torque_D_Nm, Vector3d::Zero()) << name;
  }
}

}  // namespace
}  // namespace forcegrid::driver
