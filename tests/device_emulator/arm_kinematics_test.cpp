// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/arm_kinematics.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <string>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;

// The sheets print 12 decimals.
constexpr double kPrinted = 1e-11;

profiles::DeviceProfile::Kinematics kinematics_of(const std::string& name) {
  if (name == "default_woody") {
    auto kinematics = profiles::load_device_profile("woodenhaptics_v2015").kinematics;
    kinematics.encoder_sign = {1.0, -1.0, 1.0};
    return kinematics;
  }
  return profiles::load_device_profile(name).kinematics;
}

struct Example {
  const char* profile;
  Vector3d counts;
  Vector3d position_D;
};

class WorkedExample : public testing::TestWithParam<Example> {};

TEST_P(WorkedExample, PositionFollowsFromCounts) {
  const ArmKinematics arm(kinematics_of(GetParam().profile));
  const Vector3d position_D = arm.position_D(arm.joint_angle_rad(GetParam().counts));
  EXPECT_LT((position_D - GetParam().position_D).norm(), 2.0 * kPrinted) << position_D.transpose();
}

INSTANTIATE_TEST_SUITE_P(
    WoodenHapticsSheet11_1, WorkedExample,
    testing::Values(
        Example{"woodenhaptics_v2015", {0, 0, 6000}, {0.025, 0.0, 0.205}},
        Example{"woodenhaptics_v2015",
                {1000, 2000, 6500},
                {0.118767150201, 0.067384975837, 0.209514124870}},
        Example{"woodenhaptics_v2015",
                {-1500, 1200, 5200},
                {0.069947798294, -0.087954703032, 0.144028221590}},
        Example{"woodenhaptics_v2015",
                {3000, -800, 7000},
                {-0.058670008643, 0.107797253880, 0.263930924201}},
        Example{"woodenhaptics_v2015",
                {-2500, 3500, 5000},
                {0.132141690961, -0.188223655251, 0.061385426897}},
        Example{"woodenhaptics_v2015",
                {450, -321, 6789},
                {0.001716127843, 0.019641377062, 0.254524560829}},
        Example{"default_woody", {0, 0, 6000}, {0.025, 0.0, 0.205}},
        Example{
            "default_woody", {1000, -2000, 6500}, {0.118767150201, 0.067384975837, 0.209514124870}},
        Example{"default_woody",
                {-1500, -1200, 5200},
                {0.069947798294, -0.087954703032, 0.144028221590}},
        Example{"polhem_v1", {0, 0, -5000}, {-0.007, 0.0, 0.132}},
        Example{
            "polhem_v1", {1200, -1500, -5600}, {0.065057445977, -0.043586305662, 0.137956850049}},
        Example{
            "polhem_v1", {-2200, 900, -4300}, {-0.064664015287, 0.030437713573, 0.096078050202}},
        Example{"vintage", {0, 4000, 9000}, {0.068605061175, 0.0, 0.179904945155}},
        Example{"vintage", {2500, -1000, 10500}, {-0.079945040247, 0.028004087643, 0.251690225464}},
        Example{
            "vintage", {-3333, 2222, 8888}, {0.001336785235, -0.092946886848, 0.206942162248}}));

INSTANTIATE_TEST_SUITE_P(
    PhantomSheetD1, WorkedExample,
    testing::Values(
        Example{"phantom_desktop", {0, 0, 0}, {0.020, 0.0, -0.020}},
        Example{"phantom_desktop", {1000, 0, 0}, {0.018067737097, 0.022618595807, -0.020}},
        Example{"phantom_desktop", {0, 1000, 0}, {0.018067737097, 0.0, 0.002618595807}},
        Example{"phantom_desktop", {0, 0, 1000}, {0.042618595807, 0.0, -0.018067737097}},
        Example{"phantom_desktop",
                {2000, -1500, 1200},
                {0.033767867969, 0.052187489339, -0.050943035351}},
        Example{"phantom_desktop",
                {-3500, 2500, -1000},
                {-0.031608513720, -0.055509103824, 0.037049542739}},
        Example{"phantom_desktop",
                {1234, -2345, 3456},
                {0.079235363235, 0.041113716460, -0.049416989036}},
        Example{"phantom_desktop",
                {-4321, 3210, 2109},
                {0.005771455827, -0.108002381793, 0.057895564545}}));

// A stylus gimbal leaves the tip where it is.
INSTANTIATE_TEST_SUITE_P(
    PhantomSheetD1WithItsWrist, WorkedExample,
    testing::Values(Example{"phantom_desktop_wrist", {0, 0, 0}, {0.020, 0.0, -0.020}},
                    Example{"phantom_desktop_wrist",
                            {2000, -1500, 1200},
                            {0.033767867969, 0.052187489339, -0.050943035351}},
                    Example{"phantom_desktop_wrist",
                            {1234, -2345, 3456},
                            {0.079235363235, 0.041113716460, -0.049416989036}}));

// Printed to a millionth of a count, which is less than 6e-11 m at the tip.
constexpr double kCountsPrinted_m = 2e-10;

class InverseExample : public testing::TestWithParam<Example> {};

TEST_P(InverseExample, UnroundedCountsLeadBackToThePosition) {
  const ArmKinematics arm(kinematics_of(GetParam().profile));
  const Vector3d position_D = arm.position_D(arm.joint_angle_rad(GetParam().counts));
  EXPECT_LT((position_D - GetParam().position_D).norm(), kCountsPrinted_m)
      << position_D.transpose();
}

INSTANTIATE_TEST_SUITE_P(
    Sheets11_4AndD3, InverseExample,
    testing::Values(
        Example{"woodenhaptics_v2015", {0.0, 1313.063803, 2534.758634}, {0, 0, 0}},
        Example{
            "woodenhaptics_v2015", {-563.572600, 1733.474550, 3193.439753}, {0.05, -0.03, 0.02}},
        Example{
            "woodenhaptics_v2015", {1638.662118, 1968.417683, 1415.173454}, {-0.04, 0.06, -0.05}},
        Example{"phantom_desktop", {0.0, 824.788617, -824.788617}, {0, 0, 0}},
        Example{"phantom_desktop", {-1969.008708, 2559.965701, 1374.857972}, {0.03, -0.05, 0.04}},
        Example{"phantom_desktop", {5765.290952, -1945.047692, -1328.241856}, {-0.06, 0.08, -0.06}},
        Example{"phantom_desktop", {-2536.759762, 2700.893045, 3317.698880}, {0.06, -0.08, 0.06}}));

TEST(ArmKinematics, JacobianIsThatOfTheWoodenHapticsSheet) {
  const ArmKinematics arm(kinematics_of("woodenhaptics_v2015"));
  const auto motion = arm.motion(arm.joint_angle_rad({1000, 2000, 6500}), Vector3d::Zero());
  Eigen::Matrix3d expected;
  expected << -0.067384975837, 0.174123918540, -0.031364451169,  //
      0.338767150201, 0.034635400854, -0.006238777234,           //
      0.0, -0.102500000000, 0.242903991037;
  EXPECT_LT((motion.jacobian_m_per_rad - expected).cwiseAbs().maxCoeff(), kPrinted);
}

TEST(ArmKinematics, JacobianIsThatOfThePhantomSheet) {
  const ArmKinematics arm(kinematics_of("phantom_desktop"));
  const auto motion = arm.motion(arm.joint_angle_rad({2000, -1500, 1200}), Vector3d::Zero());
  // The sheet's rows are x, y, z of frame P; D's are z, x, y of P.
  Eigen::Matrix3d expected;
  expected << -0.052187489339, 0.031782111518, 0.123057385519,  //
      0.147117867969, 0.011274147926, 0.043652454209,           //
      0.0, 0.129015555171, 0.027084416383;
  EXPECT_LT((motion.jacobian_m_per_rad - expected).cwiseAbs().maxCoeff(), kPrinted);
}

TEST(ArmKinematics, VelocityBiasIsTheTimeDerivativeOfTheJacobianTimesSpeed) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "polhem_v1"}) {
    const ArmKinematics arm(kinematics_of(name));
    const Vector3d angle(0.3, 0.2, -0.4);
    const Vector3d speed(1.1, -0.7, 2.3);
    constexpr double kStep_s = 1e-6;
    const auto before = arm.motion(angle - kStep_s * speed, speed);
    const auto after = arm.motion(angle + kStep_s * speed, speed);
    const Vector3d expected =
        (after.jacobian_m_per_rad - before.jacobian_m_per_rad) * speed / (2.0 * kStep_s);
    // Central differences: truncation 1e-11, rounding 1e-16 / 1e-6.
    EXPECT_LT((arm.motion(angle, speed).bias_m_per_s2 - expected).norm(), 1e-8) << name;
  }
}

TEST(ArmKinematics, CountsUndoesJointAngles) {
  const ArmKinematics arm(kinematics_of("polhem_v1"));
  const Vector3d counts(1200.5, -1500.25, -5600.0);
  EXPECT_LT((arm.counts(arm.joint_angle_rad(counts)) - counts).norm(), 1e-9);
}

TEST(ArmKinematics, ElbowAngleIsARightAngleInThePhantomsRestPose) {
  // phantom at rest: upper arm horizontal, forearm hanging: the links enclose a right angle.
  const ArmKinematics arm(kinematics_of("phantom_desktop"));
  EXPECT_NEAR(arm.elbow_rad(Vector3d::Zero()), 1.5707963267948966, 1e-12);
}

}  // namespace
}  // namespace forcegrid::emulator
