// SPDX-License-Identifier: Apache-2.0
// The lines of a picture against the lengths and equations of the device sheets.

#include "driver/linkage_lines.h"

#include <gtest/gtest.h>

#include <cmath>

#include "driver/mechanism.h"

namespace forcegrid::driver {
namespace {

double length_m(const LinkageLine& line, std::size_t link) {
  return (line[link + 1] - line[link]).norm();
}

TEST(LinkageLines, OfAnArmAreItsLinksFromTheBaseToTheTip) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  const auto mechanism = make_mechanism(profile);
  for (const std::array<std::int32_t, 6>& counts :
       {std::array<std::int32_t, 6>{0, 0, 0, 0, 0, 0}, {900, -700, 400, 0, 0, 0}}) {
    const ArmPose pose = mechanism->forward(counts);
    const auto lines = linkage_lines(profile, pose);
    ASSERT_EQ(lines.size(), 1U);
    ASSERT_EQ(lines[0].size(), 4U);
    EXPECT_EQ(lines[0].back(), pose.position_D);
    for (std::size_t link = 0; link < 3; ++link) {
      EXPECT_NEAR(length_m(lines[0], link), profile.kinematics.link_length_m[link], 1e-12) << link;
    }
  }
}

// Knee and platform are joined by end pieces and a shin that leaves the leg's plane: Stamper's
// (Q_u - a cos theta_1)^2 + (Q_w - a sin theta_1)^2 = (d + e + sqrt(b^2 - Q_v^2))^2.
TEST(LinkageLines, OfADeltaCloseItsThreeLegs) {
  const auto profile = profiles::load_device_profile("falcon");
  const profiles::DeviceProfile::Delta& delta = profile.delta;
  const ArmPose pose = make_mechanism(profile)->forward({-300, -650, -420, 0, 0, 0});
  ASSERT_EQ(pose.status, KinematicsStatus::kOk);
  const auto lines = linkage_lines(profile, pose);
  ASSERT_EQ(lines.size(), 3U);
  for (std::size_t leg = 0; leg < 3; ++leg) {
    ASSERT_EQ(lines[leg].size(), 4U);
    EXPECT_EQ(lines[leg].back(), pose.position_D);
    EXPECT_NEAR(length_m(lines[leg], 0), delta.thigh_m, 1e-12);
    const double azimuth_rad = delta.leg_azimuth_rad[leg];
    const Eigen::Vector3d v_D(0.0, -std::sin(azimuth_rad), std::cos(azimuth_rad));
    const Eigen::Vector3d shin_D = lines[leg][2] - lines[leg][1];
    const double out_of_plane_m = shin_D.dot(v_D);
    const double in_plane_m = (shin_D - out_of_plane_m * v_D).norm();
    EXPECT_NEAR(in_plane_m,
                delta.knee_end_m + delta.platform_end_m +
                    std::sqrt(delta.shin_m * delta.shin_m - out_of_plane_m * out_of_plane_m),
                1e-11);
  }
}

TEST(LinkageLines, OfAWristShowWhereTheStylusPoints) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015_wrist");
  // Joint E, counter e, dips the stylus by an eighth of a turn.
  const ArmPose pose = make_mechanism(profile)->forward({0, 0, 6000, 0, 128, 0});
  const auto lines = linkage_lines(profile, pose);
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(lines[0].size(), 4U);
  EXPECT_EQ(lines[1].back(), pose.position_D);
  const Eigen::Vector3d stylus_D = lines[1].front() - pose.position_D;
  EXPECT_NEAR((stylus_D - 0.05 * std::sqrt(0.5) * Eigen::Vector3d(1.0, 0.0, -1.0)).norm(), 0.0,
              1e-12);
  const ArmPose rolled = make_mechanism(profile)->forward({0, 0, 6000, 256, 0, 0});
  const auto rolled_lines = linkage_lines(profile, rolled);
  EXPECT_NEAR(length_m(rolled_lines[2], 0), 0.015, 1e-12);
  // z of the tool, rolled by a quarter turn about x, is -y.
  EXPECT_NEAR(
      (rolled_lines[2].front() - rolled.position_D - Eigen::Vector3d(0.0, -0.015, 0.0)).norm(), 0.0,
      1e-12);
}

TEST(LinkageLines, OfAPoseThatIsNotValidAreNone) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  EXPECT_TRUE(linkage_lines(profile, ArmPose{}).empty());
}

}  // namespace
}  // namespace forcegrid::driver
