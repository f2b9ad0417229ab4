// SPDX-License-Identifier: Apache-2.0
#include "calibration/motor_units.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "driver/falcon_codec.h"
#include "driver/w2_codec.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

TEST(MotorUnits, SayWhatAW2ReportCarries) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  const MotorUnits units(profile);
  // 0.0259 Nm/A through 160/10 and 120/10: 0.4144 and 0.3108 mNm a milliampere.
  const auto command = units.nearest({0.1, -0.1, 1e-5}, Vector3d::Constant(1.0));
  EXPECT_NEAR(command.joint_torque_Nm[0], 241 * 0.4144e-3, 1e-9);
  EXPECT_NEAR(command.joint_torque_Nm[1], -322 * 0.3108e-3, 1e-9);
  EXPECT_EQ(command.joint_torque_Nm[2], 0.0);
  const auto report = driver::w2::report_currents(command.motors.current_A, {6.0, 6.0, 6.0});
  EXPECT_EQ(report.current_mA, (std::array<std::int16_t, 3>{241, -322, 0}));
}

TEST(MotorUnits, SayWhatAFalconsPacketCarries) {
  const auto profile = profiles::load_device_profile("falcon");
  const MotorUnits units(profile);
  const auto command = units.nearest({0.01234, -0.05, 0.0}, Vector3d::Constant(0.2));
  EXPECT_NEAR(command.joint_torque_Nm[0], 0.0123, 1e-12);  // 10000 a newton metre
  const auto packet =
      driver::falcon::commands_for_torque(command.motors.joint_torque_Nm, 10000.0, 4095);
  EXPECT_EQ(packet.command, (std::array<std::int16_t, 3>{-123, 500, 0}));
}

TEST(MotorUnits, KeepEachJointWithinItsLimitAndNotANumberAtZero) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  const MotorUnits units(profile);
  const auto command =
      units.nearest({5.0, -5.0, std::numeric_limits<double>::quiet_NaN()}, Vector3d(0.2, 0.1, 0.1));
  EXPECT_LE(command.joint_torque_Nm[0], 0.2);
  EXPECT_GT(command.joint_torque_Nm[0], 0.199);
  EXPECT_GE(command.joint_torque_Nm[1], -0.1);
  EXPECT_EQ(command.joint_torque_Nm[2], 0.0);
  EXPECT_EQ(command.motors.current_A[2], 0.0);
}

TEST(MotorUnits, HalfOfTheLimitsIsOfTorqueAndOfCurrent) {
  const auto v2015 = profiles::load_device_profile("woodenhaptics_v2015");
  EXPECT_NEAR(MotorUnits(v2015).half_of_limits_Nm()[1], 0.7, 1e-12);  // torque: 1.4 Nm
  auto weak = v2015;
  weak.motors.max_current_A = {1.0, 1.0, 1.0};
  EXPECT_NEAR(MotorUnits(weak).half_of_limits_Nm()[1], 0.5 * 0.3108, 1e-9);
}

}  // namespace
}  // namespace forcegrid::calibration
