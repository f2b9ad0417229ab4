// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/delta_mechanism.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

namespace forcegrid::emulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegree_rad = std::numbers::pi / 180.0;
constexpr double kCount_rad = 6.359047629780477e-4;

const profiles::DeviceProfile& falcon() {
  static const profiles::DeviceProfile profile = profiles::load_device_profile("falcon");
  return profile;
}

class DeltaMechanismTest : public testing::Test {
 protected:
  DeltaMechanism::Pose at(const Vector3d& position_B) const {
    const auto pose = mechanism_.pose(mechanism_.from_base(position_B));
    EXPECT_TRUE(pose.has_value()) << position_B.transpose();
    return pose.value_or(DeltaMechanism::Pose{Vector3d::Zero(), Matrix3d::Zero()});
  }
  /// d(theta)/dx in the base frame: columns x_B, y_B, z_B are y_D, z_D, x_D.
  Matrix3d rate_B(const Vector3d& position_B) const {
    const Matrix3d rate_D = at(position_B).rate_rad_per_m;
    Matrix3d result;
    result << rate_D.col(1), rate_D.col(2), rate_D.col(0);
    return result;
  }
  DeltaMechanism mechanism_{falcon().delta};
};

TEST_F(DeltaMechanismTest, FramesAreACyclicExchangeOfAxesAboutTheCenter) {
  // The middle is at z = 0.120 of the base; x_D out of the device, y_D right, z_D up.
  EXPECT_LT((mechanism_.to_base(Vector3d::Zero()) - Vector3d(0.0, 0.0, 0.120)).norm(), 1e-15);
  EXPECT_LT((mechanism_.to_base({0.01, 0.02, 0.03}) - Vector3d(0.02, 0.03, 0.130)).norm(), 1e-15);
  const Vector3d position_D(0.011, -0.022, 0.033);
  EXPECT_LT((mechanism_.from_base(mechanism_.to_base(position_D)) - position_D).norm(), 1e-15);
}

TEST_F(DeltaMechanismTest, HoldsTheSheetsOnAxisTable) {
  // Section 7.5: z [m], theta [degrees], dz/dtheta of one leg [m/rad].
  constexpr std::array<std::array<double, 3>, 13> kRows = {{{0.075, -18.319477, 0.013459},
                                                            {0.080, -11.800048, 0.015841},
                                                            {0.090, -1.054972, 0.019651},
                                                            {0.100, 8.008076, 0.022389},
                                                            {0.110, 16.187960, 0.024180},
                                                            {0.120, 23.918022, 0.025098},
                                                            {0.125, 27.709292, 0.025243},
                                                            {0.134602428, 35.000000, 0.024938},
                                                            {0.150, 47.243273, 0.022768},
                                                            {0.160, 56.136420, 0.020038},
                                                            {0.170, 66.756141, 0.015772},
                                                            {0.175, 73.464848, 0.012652},
                                                            {0.180, 82.682577, 0.008015}}};
  for (const auto& [z_m, angle_deg, dz_m_per_rad] : kRows) {
    const Matrix3d jacobian = rate_B({0.0, 0.0, z_m}).inverse();
    for (int leg = 0; leg < 3; ++leg) {
      EXPECT_NEAR(at({0.0, 0.0, z_m}).joint_angle_rad[leg] / kDegree_rad, angle_deg, 1e-6) << z_m;
      EXPECT_NEAR(jacobian(2, leg), dz_m_per_rad, 1e-6) << z_m;
    }
  }
  EXPECT_FALSE(mechanism_.pose(mechanism_.from_base({0.0, 0.0, 0.185})).has_value());
}

TEST_F(DeltaMechanismTest, HoldsTheSheetsPositions) {
  // Section 9.1: counts and the place they mean.
  struct Row {
    Vector3d counts;
    Vector3d position_B;
  };
  const std::array<Row, 8> rows = {
      Row{{0, 0, 0}, {0.0, 0.0, 0.134602428444}},
      Row{{100, 100, 100}, {0.0, 0.0, 0.139321359259}},
      Row{{-500, -500, -500}, {0.0, 0.0, 0.110754499105}},
      Row{{-300, -650, -420}, {0.008943261911, -0.006036252787, 0.112189283513}},
      Row{{217, -226, 291}, {0.020246830321, -0.001566710053, 0.137106230358}},
      Row{{456, -998, -29}, {0.037290229198, -0.028302454267, 0.114221603622}},
      Row{{-1430, -287, 148}, {0.001969846787, 0.043933681733, 0.099246434573}},
      Row{{755, -96, 605}, {0.030950657591, -0.014053899693, 0.148361160391}}};
  for (const Row& row : rows) {
    const Vector3d counts =
        (at(row.position_B).joint_angle_rad.array() - 35.0 * kDegree_rad) / kCount_rad;
    // The table has 12 decimals: 1e-12 m are some 1e-7 counts.
    EXPECT_LT((counts - row.counts).norm(), 1e-6) << row.counts.transpose();
  }
  // Section 9.2: the other way round, angles [rad].
  const std::array<Row, 6> angles = {
      Row{{0.282533201336, 0.282533201336, 0.282533201336}, {0.0, 0.0, 0.11}},
      Row{{0.620778651001, 0.200581898647, 0.529684680148}, {0.02, -0.01, 0.12}},
      Row{{0.306569915418, 0.978429593993, 0.655031876130}, {-0.03, 0.025, 0.13}},
      Row{{0.071492256087, 0.032394961966, 0.996895152082}, {0.04, 0.04, 0.1}},
      Row{{1.188145092091, 1.077181506123, 0.548179978393}, {-0.02, -0.035, 0.15}},
      Row{{1.103593785320, 0.985837965005, 1.135169004666}, {0.01, 0.0, 0.165}}};
  for (const Row& row : angles) {
    EXPECT_LT((at(row.position_B).joint_angle_rad - row.counts).norm(), 2e-12)
        << row.position_B.transpose();
  }
}

TEST_F(DeltaMechanismTest, HoldsTheSheetsJacobianAndTorques) {
  // Section 9.3.
  Matrix3d expected;
  expected << 6.2082256464, -11.0460760524, 11.7107332142,  //
      -8.7824651294, 1.2159749059, 15.2188977976,           //
      10.6059469353, 5.9688583176, 12.4511509634;
  EXPECT_LT((rate_B({0.02, -0.01, 0.12}) - expected).norm(), 1e-9);
  // Section 9.4: a force on the hand and the torques that make it.
  struct Row {
    Vector3d position_B;
    Vector3d force_B;
    Vector3d torque_Nm;
  };
  for (const Row& row : {Row{{0.02, -0.01, 0.12},
                             {1.5, -2.0, 0.75},
                             {0.166612722942, -0.068462352799, -0.012788825604}},
                         Row{{-0.03, 0.025, 0.13},
                             {-1.0, 0.5, -2.0},
                             {-0.125387289504, 0.088718020271, -0.078291221778}},
                         Row{{-0.02, -0.035, 0.15},
                             {2.5, 1.0, -0.5},
                             {0.012081616571, -0.162085114692, 0.114963619770}}}) {
    EXPECT_LT((rate_B(row.position_B).transpose() * row.torque_Nm - row.force_B).norm(), 1e-9);
  }
}

/// The closure of section 7.3, solved for the knob by Newton's method with its own derivatives: the
/// forward kinematics that DeltaMechanism does without.
Vector3d forward_B(const Vector3d& angles_rad) {
  const auto& delta = falcon().delta;
  Vector3d p(0.0, 0.0, 0.12);
  for (int iteration = 0; iteration < 50; ++iteration) {
    Vector3d residual;
    Matrix3d gradient;
    for (int leg = 0; leg < 3; ++leg) {
      const double phi = delta.leg_azimuth_rad[static_cast<std::size_t>(leg)];
      const double u = p.x() * std::cos(phi) + p.y() * std::sin(phi) - delta.base_offset_u_m +
                       delta.platform_offset_u_m - delta.thigh_m * std::cos(angles_rad[leg]);
      const double v = -p.x() * std::sin(phi) + p.y() * std::cos(phi) - delta.base_offset_v_m +
                       delta.platform_offset_v_m;
      const double w = p.z() - delta.thigh_m * std::sin(angles_rad[leg]);
      const double d = std::hypot(u, w);
      const double s = std::sqrt(delta.shin_m * delta.shin_m - v * v);
      residual[leg] = d - delta.knee_end_m - delta.platform_end_m - s;
      gradient.row(leg) << u / d * std::cos(phi) - v / s * std::sin(phi),
          u / d * std::sin(phi) + v / s * std::cos(phi), w / d;
    }
    p -= gradient.partialPivLu().solve(residual);
    if (residual.norm() < 1e-15) {
      break;
    }
  }
  return p;
}

TEST_F(DeltaMechanismTest, AnglesCloseTheLegsOverTheWholeWorkspace) {
  const auto& limits = falcon().limits;
  constexpr int kSteps = 12;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      for (int k = 0; k <= kSteps; ++k) {
        const auto along = [&](std::size_t axis, int step) {
          return limits.workspace_min_m[axis] +
                 (limits.workspace_max_m[axis] - limits.workspace_min_m[axis]) * step / kSteps;
        };
        const Vector3d position_D(along(0, i), along(1, j), along(2, k));
        const auto pose = mechanism_.pose(position_D);
        ASSERT_TRUE(pose.has_value());
        ASSERT_LT((mechanism_.from_base(forward_B(pose->joint_angle_rad)) - position_D).norm(),
                  1e-9);
      }
    }
  }
}

TEST_F(DeltaMechanismTest, RateAndBiasAreTheDerivativesOfTheAngles) {
  constexpr unsigned kSeed = 3;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  for (int i = 0; i < 200; ++i) {
    const Vector3d position_D(0.030 * along(random), 0.040 * along(random), 0.040 * along(random));
    const Vector3d velocity_D(along(random), along(random), along(random));
    const auto pose = mechanism_.pose(position_D);
    ASSERT_TRUE(pose.has_value());
    constexpr double kStep_s = 1e-5;
    const Vector3d ahead = mechanism_.pose(position_D + kStep_s * velocity_D)->joint_angle_rad;
    const Vector3d behind = mechanism_.pose(position_D - kStep_s * velocity_D)->joint_angle_rad;
    const Vector3d rate = (ahead - behind) / (2.0 * kStep_s);
    EXPECT_LT((pose->rate_rad_per_m * velocity_D - rate).norm(), 1e-6 * rate.norm() + 1e-8);
    // theta'' at constant velocity; rounding of the angles is 1e-16 / 1e-10.
    const Vector3d second = (ahead - 2.0 * pose->joint_angle_rad + behind) / (kStep_s * kStep_s);
    EXPECT_LT((mechanism_.bias_rad_per_s2(position_D, velocity_D) - second).norm(),
              1e-3 * second.norm() + 1e-4);
  }
  EXPECT_EQ(mechanism_.bias_rad_per_s2(Vector3d::Zero(), Vector3d::Zero()), Vector3d::Zero());
}

TEST_F(DeltaMechanismTest, PowerAtTheJointsIsPowerAtTheKnob) {
  constexpr unsigned kSeed = 4;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  for (int i = 0; i < 200; ++i) {
    const Vector3d position_D(0.030 * along(random), 0.040 * along(random), 0.040 * along(random));
    const Vector3d velocity_D(along(random), along(random), along(random));
    const Vector3d torque_Nm = 0.4 * Vector3d(along(random), along(random), along(random));
    const auto pose = mechanism_.pose(position_D);
    ASSERT_TRUE(pose.has_value());
    // Angular speed from the angles themselves, not from the rate that the force comes from.
    constexpr double kStep_s = 1e-5;
    const Vector3d speed_rad_per_s =
        (mechanism_.pose(position_D + kStep_s * velocity_D)->joint_angle_rad -
         mechanism_.pose(position_D - kStep_s * velocity_D)->joint_angle_rad) /
        (2.0 * kStep_s);
    const Vector3d force_N = pose->rate_rad_per_m.transpose() * torque_Nm;
    EXPECT_NEAR(torque_Nm.dot(speed_rad_per_s), force_N.dot(velocity_D),
                1e-5 * torque_Nm.norm() * speed_rad_per_s.norm() + 1e-9);
  }
}

TEST_F(DeltaMechanismTest, OutOfReachAndNotFiniteHaveNoPose) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vector3d& position_D :
       {Vector3d(1.0, 0.0, 0.0), Vector3d(0.0, 0.2, 0.0), Vector3d(0.0, 0.0, -0.3),
        Vector3d(nan, 0.0, 0.0), Vector3d(0.0, nan, 0.0)}) {
    EXPECT_FALSE(mechanism_.pose(position_D).has_value()) << position_D.transpose();
    EXPECT_EQ(mechanism_.bias_rad_per_s2(position_D, Vector3d(0.1, 0.0, 0.0)), Vector3d::Zero());
  }
}

}  // namespace
}  // namespace forcegrid::emulator
