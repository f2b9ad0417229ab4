// SPDX-License-Identifier: Apache-2.0
#include "driver/gimbal_kinematics.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

#include "driver/mechanism.h"

namespace forcegrid::driver {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Counts = std::array<std::int32_t, 6>;
using profiles::DeviceProfile;
using profiles::load_device_profile;

constexpr double kRounding = 1e-12;
constexpr Counts kPose = {0, 0, 6000, 0, 0, 0};
constexpr std::int32_t kQuarter_counts = 256;

DeviceProfile wrist_profile() { return load_device_profile("woodenhaptics_v2015_wrist"); }

ArmPose pose_at(const Counts& counts) { return make_mechanism(wrist_profile())->forward(counts); }

void expect_vector(const Vector3d& actual, const Vector3d& expected) {
  EXPECT_LT((actual - expected).norm(), kRounding) << actual.transpose();
}

TEST(GimbalKinematics, KeepsTheAxesOfDInTheCalibrationPose) {
  const ArmPose pose = pose_at(kPose);
  EXPECT_EQ(pose.status, KinematicsStatus::kOk);
  EXPECT_TRUE(pose.has_orientation);
  EXPECT_LT((pose.rotation_DT - Matrix3d::Identity()).norm(), kRounding);
  EXPECT_EQ(quaternion_wxyz(Matrix3d::Identity()), (std::array<double, 4>{1, 0, 0, 0}));
}

// R = Rz(theta_A) Ry(pi/2 - theta_C) Rx(theta_D) Ry(theta_E) Rx(theta_F) with (D, E, F) from the
// counters (f, e, d): the sheet's formula, multiplied out as quaternions in another language.
TEST(GimbalKinematics, IsTheSheetsFormulaForItsCounters) {
  const struct {
    Counts counts;
    std::array<double, 4> wxyz;
  } examples[] = {{{1000, 2000, 6500, 100, -50, 200},
                   {0.584234919494, 0.802115353186, -0.106379085714, 0.062960377617}},
                  {{-1500, 1200, 5200, -300, 120, -40},
                   {0.486131263366, -0.722470951814, 0.409513366767, 0.272049482636}},
                  {{3000, -800, 7000, 333, 222, -111},
                   {0.747661434477, 0.526369051566, 0.212454887875, -0.344675095659}}};
  for (const auto& example : examples) {
    const auto wxyz = quaternion_wxyz(pose_at(example.counts).rotation_DT);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(wxyz[i], example.wxyz[i], 1e-11) << "element " << i;  // printed with 12 digits
    }
  }
}

TEST(GimbalKinematics, TurnsEachAxisWithItsOwnCounter) {
  // Joint D, counter f, about x of the last link: y of the tool goes up.
  const Matrix3d roll = pose_at({0, 0, 6000, 0, 0, kQuarter_counts}).rotation_DT;
  expect_vector(roll.col(0), Vector3d::UnitX());
  expect_vector(roll.col(1), Vector3d::UnitZ());
  // Joint E, counter e, about y: a quarter turn would be beyond its stops; an eighth lets x dip.
  const Matrix3d pitch = pose_at({0, 0, 6000, 0, kQuarter_counts / 2, 0}).rotation_DT;
  expect_vector(pitch.col(0), Vector3d(std::sqrt(0.5), 0.0, -std::sqrt(0.5)));
  expect_vector(pitch.col(1), Vector3d::UnitY());
  // Joint F, counter d, is the last: about x of the tool, wherever the others point it.
  const Matrix3d twisted =
      pose_at({0, 0, 6000, kQuarter_counts, kQuarter_counts / 2, 0}).rotation_DT;
  expect_vector(twisted.col(0), pitch.col(0));
  expect_vector(twisted.col(1), pitch.col(2));
}

TEST(GimbalKinematics, CarriesTheToolWithTheLastLink) {
  // 8000 counts of the base are a quarter turn; the elbow's 24000 are a whole one.
  for (const std::int32_t elbow : {3000, 4500, 6000, 7200}) {
    const ArmPose pose = pose_at({1000, 300, elbow, 0, 0, 0});
    const double yaw_rad = 2.0 * std::numbers::pi * 1000 / 32000;
    const double theta_c_rad = 2.0 * std::numbers::pi * elbow / 24000;
    const Vector3d outward(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
    expect_vector(pose.rotation_DT.col(0),
                  std::sin(theta_c_rad) * outward - std::cos(theta_c_rad) * Vector3d::UnitZ());
    // The shoulder does not turn it: the elbow's drive keeps the link's direction.
    EXPECT_EQ(pose.rotation_DT, pose_at({1000, -200, elbow, 0, 0, 0}).rotation_DT);
  }
}

TEST(GimbalKinematics, FollowsSignsAxesAndOrderOfTheProfile) {
  DeviceProfile profile = wrist_profile();
  profile.gimbal.axis = {2, 1, 0};
  profile.gimbal.counter = {3, 4, 5};
  profile.gimbal.encoder_sign = {-1, 1, -1};
  profile.gimbal.encoder_counts_per_turn = {1000, 2000, 4000};
  const Counts counts = {0, 0, 6000, 50, 200, -300};
  const Matrix3d expected = (AngleAxisd(-2 * std::numbers::pi * 50 / 1000, Vector3d::UnitZ()) *
                             AngleAxisd(2 * std::numbers::pi * 200 / 2000, Vector3d::UnitY()) *
                             AngleAxisd(2 * std::numbers::pi * 300 / 4000, Vector3d::UnitX()))
                                .toRotationMatrix();
  const ArmPose pose = make_mechanism(profile)->forward(counts);
  EXPECT_LT((pose.rotation_DT - expected).norm(), kRounding);
}

Vector3d vee(const Matrix3d& skew) { return {skew(2, 1), skew(0, 2), skew(1, 0)}; }

// Angular velocity from the axes against central differences of the rotation: [w] = R' R^T.
TEST(GimbalKinematics, HasTheAxesThatItsRotationTurnsAbout) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const DeviceProfile profile = wrist_profile();
  const auto mechanism = make_mechanism(profile);
  // Whole counts are all that forward() takes, so the step is one count to either side.
  for (int trial = 0; trial < 200; ++trial) {
    const Counts at = {static_cast<std::int32_t>(3000 * any(random)),
                       static_cast<std::int32_t>(800 * any(random)),
                       static_cast<std::int32_t>(6000 + 1000 * any(random)),
                       static_cast<std::int32_t>(400 * any(random)),
                       static_cast<std::int32_t>(200 * any(random)),
                       static_cast<std::int32_t>(400 * any(random))};
    const ArmPose pose = mechanism->forward(at);
    for (std::size_t counter = 0; counter < 6; ++counter) {
      const auto step = static_cast<std::int32_t>(counter < 3 ? 8 : 1);
      Counts before = at;
      Counts after = at;
      before[counter] -= step;
      after[counter] += step;
      const double rad_per_count = counter == 0  ? 2 * std::numbers::pi / 32000
                                   : counter < 3 ? 2 * std::numbers::pi / 24000
                                                 : 2 * std::numbers::pi / 1024;
      const Matrix3d rate =
          (mechanism->forward(after).rotation_DT - mechanism->forward(before).rotation_DT) /
          (2 * step * rad_per_count);
      const Matrix3d skew = rate * pose.rotation_DT.transpose();
      const int joint = counter < 3 ? static_cast<int>(counter) : 5 - static_cast<int>(counter);
      const Vector3d axis =
          counter < 3 ? pose.arm_axis_D.col(joint) : pose.gimbal_axis_D.col(joint);
      // sin(h)/h of a step of h = 6.1 mrad is 1 - 6.3e-6.
      EXPECT_LT((vee(skew) - axis).norm(), 1e-5) << "counter " << counter;
    }
  }
}

TEST(GimbalKinematics, IsOrthonormalAndItsQuaternionIsEigensWithAPositiveW) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_int_distribution<std::int32_t> counts(-420, 420);
  for (int trial = 0; trial < 1000; ++trial) {
    const ArmPose pose = pose_at({5 * counts(random), counts(random), 6000 + counts(random),
                                  counts(random), counts(random) / 2, counts(random)});
    const Matrix3d& rotation = pose.rotation_DT;
    EXPECT_LT((rotation.transpose() * rotation - Matrix3d::Identity()).norm(), kRounding);
    EXPECT_NEAR(rotation.determinant(), 1.0, kRounding);
    const auto [w, x, y, z] = quaternion_wxyz(rotation);
    EXPECT_GE(w, 0.0);
    EXPECT_NEAR(std::hypot(std::hypot(w, x), std::hypot(y, z)), 1.0, kRounding);
    EXPECT_LT((Quaterniond(w, x, y, z).toRotationMatrix() - rotation).norm(), kRounding);
  }
}

TEST(GimbalKinematics, CallsAWristBeyondItsStopsOutOfRange) {
  // 1.4 rad are 228 counts of e, and the stops give by 0.05 rad, 8 counts.
  EXPECT_EQ(pose_at({0, 0, 6000, 0, 235, 0}).status, KinematicsStatus::kOk);
  EXPECT_EQ(pose_at({0, 0, 6000, 0, 238, 0}).status, KinematicsStatus::kOutOfRange);
  EXPECT_EQ(pose_at({0, 0, 6000, 0, -238, 0}).status, KinematicsStatus::kOutOfRange);
}

TEST(GimbalKinematics, LeavesADeviceWithoutAWristTheIdentity) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "falcon"}) {
    const DeviceProfile profile = load_device_profile(name);
    const Counts counts = profile.kind == profiles::DeviceKind::kDelta
                              ? Counts{}
                              : Counts{100, 200, 300, 777, -888, 999};
    const ArmPose pose = make_mechanism(profile)->forward(counts);
    EXPECT_FALSE(pose.has_orientation) << name;
    EXPECT_EQ(pose.rotation_DT, Matrix3d::Identity()) << name;
    EXPECT_EQ(pose.gimbal_angle_rad, Vector3d::Zero()) << name;
    EXPECT_EQ(pose.gimbal_axis_D, Matrix3d::Zero()) << name;
    EXPECT_TRUE((gimbal_angle_per_count_rad(profile) == 0.0).all()) << name;
  }
}

TEST(GimbalKinematics, DoesNotChangeWhereTheArmIs) {
  const Counts counts = {1000, 2000, 6500, 150, -60, 90};
  const ArmPose with = pose_at(counts);
  const ArmPose without =
      make_mechanism(load_device_profile("woodenhaptics_v2015"))->forward(counts);
  EXPECT_EQ(with.position_D, without.position_D);
  EXPECT_EQ(with.jacobian_D, without.jacobian_D);
  EXPECT_EQ(with.status, without.status);
}

}  // namespace
}  // namespace forcegrid::driver
