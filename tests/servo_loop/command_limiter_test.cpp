// SPDX-License-Identifier: Apache-2.0
// The stage between the wanted force and the motors' currents.

#include "servo_loop/command_limiter.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;
using std::chrono::milliseconds;

constexpr rt::Duration kPeriod = milliseconds(2);
constexpr double kPeriod_s = 0.002;
constexpr double kRounding = 1e-12;

class CommandLimits : public ::testing::Test {
 protected:
  explicit CommandLimits(const char* profile = "woodenhaptics_v2015")
      : profile_(profiles::load_device_profile(profile)),
        pose_(pose_at(driver::ArmKinematics(profile_), Vector3d(0.01, 0.02, 0.03))) {}

  static driver::ArmPose pose_at(const driver::ArmKinematics& arm, const Vector3d& position_D) {
    return arm.forward(arm.inverse(position_D).counts);
  }

  /// One cycle. Encoders do not count unless the test changes `report_`.
  driver::LimitedForce cycle(CommandLimiter& limiter, const CommandLimiter::Wanted& wanted) {
    now_ += kPeriod;
    ++report_.sequence;
    report_.released = now_ - milliseconds(1);
    frozen_ = limiter.stuck_encoder(now_, report_);
    return limiter.apply(now_, kPeriod_s, wanted, pose_);
  }

  profiles::DeviceProfile profile_;
  driver::ArmPose pose_;
  driver::DeviceReport report_;
  rt::TimePoint now_{std::chrono::seconds(1000)};
  std::optional<int> frozen_;
};

TEST_F(CommandLimits, OfAColdArmAreThoseOfTheForceLimiter) {
  CommandLimiter limiter(profile_, true);
  driver::ForceLimiter reference(profile_);
  const CommandLimiter::Wanted wanted{.force_D = Vector3d(0.3, -0.2, 0.1),
                                      .extra_torque_Nm = Vector3d(0.0, 0.01, 0.02)};
  for (int i = 0; i < 10; ++i) {
    const driver::LimitedForce limited = cycle(limiter, wanted);
    const driver::LimitedForce expected =
        reference.apply(wanted.force_D, pose_, kPeriod_s, wanted.extra_torque_Nm);
    EXPECT_EQ(limited.force_D, expected.force_D);
    EXPECT_EQ(limited.joint_torque_Nm, expected.joint_torque_Nm);
    EXPECT_EQ(limited.current_A, expected.current_A);
    EXPECT_EQ(limited.acted, expected.acted);
  }
}

TEST_F(CommandLimits, AFaultCommandsZeroOfEverything) {
  CommandLimiter limiter(profile_, true);
  CommandLimiter::Wanted wanted{.force_D = Vector3d(0.0, 0.0, 1.0),
                                .extra_torque_Nm = Vector3d(0.1, 0.1, 0.1)};
  EXPECT_NE(cycle(limiter, wanted).current_A, (std::array<double, 3>{}));
  wanted.zero = true;
  const driver::LimitedForce limited = cycle(limiter, wanted);
  EXPECT_EQ(limited.current_A, (std::array<double, 3>{}));
  EXPECT_EQ(limited.joint_torque_Nm, Vector3d::Zero());
  EXPECT_EQ(limited.force_D, Vector3d::Zero());
}

TEST_F(CommandLimits, AForceThatIsNotFiniteCommandsZeroAndSaysSo) {
  CommandLimiter limiter(profile_, true);
  const driver::LimitedForce limited =
      cycle(limiter, {.force_D = Vector3d(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0)});
  EXPECT_EQ(limited.acted, driver::kLimitNotFinite);
  EXPECT_EQ(limited.current_A, (std::array<double, 3>{}));
  EXPECT_EQ(limited.force_D, Vector3d::Zero());
}

TEST_F(CommandLimits, AStuckEncoderLosesTheForcesTorqueButKeepsTheWeightOfTheLinks) {
  CommandLimiter limiter(profile_, true);
  const Vector3d force_D(0.0, 0.0, 2.0);
  // Along the force's torque: relief shortens a joint's torque and never reverses it.
  const Vector3d force_torque_Nm = pose_.jacobian_D.transpose() * force_D;
  const Vector3d weight_Nm = 0.02 * force_torque_Nm.cwiseSign();
  const CommandLimiter::Wanted wanted{.force_D = force_D, .extra_torque_Nm = weight_Nm};
  driver::LimitedForce limited;
  for (int i = 0; i < 58; ++i) {  // 116 ms: suspected after 60, relieved within another 40
    limited = cycle(limiter, wanted);
    ASSERT_EQ(frozen_, std::nullopt);
  }
  ASSERT_EQ(limited.acted, 0) << "no limit has scaled the torque";
  EXPECT_GE(limiter.suspected_stuck_encoders(), 1U);
  EXPECT_NEAR((limited.joint_torque_Nm - weight_Nm).norm(), 0.0, kRounding);
  EXPECT_NEAR(limited.force_D.z(), 2.0, kRounding) << "which the slew limit goes on from";
  for (int i = 0; i < 40 && !frozen_; ++i) {
    cycle(limiter, wanted);
  }
  EXPECT_NE(frozen_, std::nullopt);
}

TEST_F(CommandLimits, AnEncoderThatCountsKeepsItsTorque) {
  CommandLimiter limiter(profile_, true);
  const CommandLimiter::Wanted wanted{.force_D = Vector3d(0.0, 0.0, 4.0)};
  driver::LimitedForce limited;
  for (int i = 0; i < 200; ++i) {
    for (std::int32_t& counts : report_.counts) {
      counts += i % 2 == 0 ? 1 : -1;
    }
    limited = cycle(limiter, wanted);
  }
  EXPECT_EQ(limiter.suspected_stuck_encoders(), 0U);
  EXPECT_GT(limited.joint_torque_Nm.norm(), 0.0);
}

TEST_F(CommandLimits, WithoutTheWatchNoEncoderIsSuspected) {
  CommandLimiter limiter(profile_, false);
  driver::LimitedForce limited;
  for (int i = 0; i < 200; ++i) {
    limited = cycle(limiter, {.force_D = Vector3d(0.0, 0.0, 4.0)});
    ASSERT_EQ(frozen_, std::nullopt);
  }
  EXPECT_EQ(limiter.suspected_stuck_encoders(), 0U);
  EXPECT_GT(limited.joint_torque_Nm.norm(), 0.0);
}

TEST_F(CommandLimits, ARestartGrowsTheForceFromZero) {
  CommandLimiter limiter(profile_, true);
  const CommandLimiter::Wanted wanted{.force_D = Vector3d(0.0, 0.0, 4.0)};
  const double first_N = cycle(limiter, wanted).force_D.norm();
  EXPECT_GT(cycle(limiter, wanted).force_D.norm(), first_N);
  limiter.restart();
  EXPECT_NEAR(cycle(limiter, wanted).force_D.norm(), first_N, kRounding);
}

class WarmCommandLimits : public CommandLimits {
 protected:
  WarmCommandLimits() : CommandLimits("phantom_desktop") {}
};

// The peak current warms a motor until less is allowed; the joints keep their proportions.
TEST_F(WarmCommandLimits, ScaleAllJointsAlikeAndRaiseTheFlag) {
  CommandLimiter limiter(profile_, false);
  const CommandLimiter::Wanted wanted{.extra_torque_Nm = Vector3d(1.0, 10.0, 0.5)};
  const driver::LimitedForce cold = cycle(limiter, wanted);
  EXPECT_EQ(cold.acted & driver::kLimitWarm, 0);
  driver::LimitedForce warm = cold;
  for (int i = 0; i < 60'000 && (warm.acted & driver::kLimitWarm) == 0; ++i) {
    warm = cycle(limiter, wanted);
  }
  ASSERT_NE(warm.acted & driver::kLimitWarm, 0);
  EXPECT_GT(limiter.warmest_motor(), MotorWarmth::kFull);
  const double scale = warm.joint_torque_Nm.norm() / cold.joint_torque_Nm.norm();
  EXPECT_LT(scale, 1.0);
  EXPECT_NEAR(warm.torque_scale, scale * cold.torque_scale, kRounding);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(warm.current_A[i], scale * cold.current_A[i], kRounding);
  }
  const double warmth = limiter.warmest_motor();
  limiter.restart();
  EXPECT_EQ(limiter.warmest_motor(), warmth) << "a pause of the loop does not cool the windings";
}

}  // namespace
}  // namespace forcegrid::servo
