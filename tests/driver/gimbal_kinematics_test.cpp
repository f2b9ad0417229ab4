// SPDX-License-Identifier: Apache-2.0
#include "driver/gimbal_kinematics.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

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
  const struct {
    const char* with;
    const char* without;
    Counts counts;
  } examples[] = {
      {"woodenhaptics_v2015_wrist", "woodenhaptics_v2015", {1000, 2000, 6500, 150, -60, 90}},
      {"phantom_desktop_wrist", "phantom_desktop", {2000, -1500, 1200, 300, -700, -200}}};
  for (const auto& example : examples) {
    const ArmPose with = make_mechanism(load_device_profile(example.with))->forward(example.counts);
    const ArmPose without =
        make_mechanism(load_device_profile(example.without))->forward(example.counts);
    EXPECT_EQ(with.position_D, without.position_D) << example.with;
    EXPECT_EQ(with.jacobian_D, without.jacobian_D) << example.with;
    EXPECT_EQ(with.status, without.status) << example.with;
  }
}

// Worked examples of the PHANTOM sheet, D.1, with the stylus turned: the tip stays, and the tool is
// turned by yaw about the forearm, pitch across it and roll about the handle.
TEST(PhantomGimbal, TurnsTheToolAtTheSheetsPositions) {
  constexpr double kPrinted_m = 1e-12;
  const auto mechanism = make_mechanism(load_device_profile("phantom_desktop_wrist"));
  const struct {
    Counts counts;
    Vector3d joint_angle_rad;
    Vector3d position_D;
  } examples[] = {{{0, 0, 0, 0, -653, 0}, {0.0, 0.0, 0.0}, {0.020, 0.0, -0.020}},
                  {{1000, 0, 0, 300, -653, 0},
                   {0.170442309765, 0.0, 0.0},
                   {0.018067737097, 0.022618595807, -0.020}},
                  {{2000, -1500, 1200, -400, -200, 500},
                   {0.340884619530, -0.255663464648, 0.204530771718},
                   {0.033767867969, 0.052187489339, -0.050943035351}},
                  {{-3500, 2500, -1000, 123, -1000, -321},
                   {-0.596548084178, 0.426105774413, -0.170442309765},
                   {-0.031608513720, -0.055509103824, 0.037049542739}},
                  {{-4321, 3210, 2109, 512, -17, 0},
                   {-0.736481220495, 0.547119814346, 0.359462831295},
                   {0.005771455827, -0.108002381793, 0.057895564545}}};
  for (const auto& example : examples) {
    SCOPED_TRACE("counter a " + std::to_string(example.counts[0]));
    const ArmPose pose = mechanism->forward(example.counts);
    ASSERT_EQ(pose.status, KinematicsStatus::kOk);
    ASSERT_TRUE(pose.has_orientation);
    EXPECT_LT((pose.position_D - example.position_D).norm(), 2.0 * kPrinted_m);
    // theta1 yaws the arm; theta3 is the forearm's angle from straight down toward the user.
    const double yaw_rad = 2.0 * std::numbers::pi * example.counts[3] / 1270;
    const double pitch_rad = 2.0 * std::numbers::pi * example.counts[4] / 2612;
    const double roll_rad = 2.0 * std::numbers::pi * example.counts[5] / 1231;
    const Matrix3d expected =
        (AngleAxisd(example.joint_angle_rad[0], Vector3d::UnitZ()) *
         AngleAxisd(0.5 * std::numbers::pi - example.joint_angle_rad[2], Vector3d::UnitY()) *
         AngleAxisd(yaw_rad, Vector3d::UnitX()) * AngleAxisd(pitch_rad, Vector3d::UnitY()) *
         AngleAxisd(roll_rad, Vector3d::UnitX()))
            .toRotationMatrix();
    EXPECT_LT((pose.rotation_DT - expected).norm(), 10.0 * kPrinted_m) << "the angles' 12 digits";
    const Vector3d angle_rad(yaw_rad, pitch_rad, roll_rad);
    EXPECT_LT((pose.gimbal_angle_rad - angle_rad).norm(), kRounding);
  }
}

TEST(PhantomGimbal, PointsItsHandleWhereTheSourcesDo) {
  const auto mechanism = make_mechanism(load_device_profile("phantom_desktop_wrist"));
  const auto rotation = [&](const Counts& counts) {
    return mechanism->forward(counts).rotation_DT;
  };
  // In the calibration pose it points at the user, and the tool has the axes of D.
  EXPECT_LT((rotation({0, 0, 0, 0, -653, 0}) - Matrix3d::Identity()).norm(), kRounding);
  // In line with the forearm, which hangs.
  expect_vector(rotation({0, 0, 0, 0, 0, 0}).col(0), -Vector3d::UnitZ());
  // Folded up as far as it goes, 0.89 rad above level.
  const Vector3d up_D = rotation({0, 0, 0, 0, -1022, 0}).col(0);
  EXPECT_NEAR(std::asin(up_D.z()), 2.0 * std::numbers::pi * (1022 - 653) / 2612, kRounding);
  EXPECT_GT(up_D.x(), 0.0);
  // Yaw about the forearm, which points down: the handle turns to the user's left.
  const Vector3d left_D = rotation({0, 0, 0, 100, -653, 0}).col(0);
  const double yaw_rad = 2.0 * std::numbers::pi * 100 / 1270;
  expect_vector(left_D, Vector3d(std::cos(yaw_rad), -std::sin(yaw_rad), 0.0));
  // Roll leaves it where it is.
  expect_vector(rotation({0, 0, 0, 0, -653, 200}).col(0), Vector3d::UnitX());
  // The stops, and 0.05 rad more: in line is one.
  EXPECT_EQ(mechanism->forward(Counts{0, 0, 0, 0, 20, 0}).status, KinematicsStatus::kOk);
  EXPECT_EQ(mechanism->forward(Counts{0, 0, 0, 0, 21, 0}).status, KinematicsStatus::kOutOfRange);
  EXPECT_EQ(mechanism->forward(Counts{0, 0, 0, -518, -653, 0}).status,
            KinematicsStatus::kOutOfRange);
  EXPECT_EQ(mechanism->forward(Counts{0, 0, 0, 525, -653, 0}).status, KinematicsStatus::kOk);
}

}  // namespace
}  // namespace forcegrid::driver
