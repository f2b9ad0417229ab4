// SPDX-License-Identifier: Apache-2.0
#include "driver/delta_kinematics.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "falcon_sheet.h"

namespace forcegrid::driver {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPrinted = 1.5e-12;       // the sheet prints 12 decimals
constexpr double kPrintedCounts = 1.5e-8;  // and 8 of counts
constexpr double kDegree = std::numbers::pi / 180.0;

class Delta : public testing::Test {
 protected:
  const DeltaKinematics kinematics_{falcon_sheet_geometry()};
};

void expect_near(const Vector3d& actual, const Vector3d& expected, double tolerance) {
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(actual[i], expected[i], tolerance) << "element " << i;
  }
}

// --- the sheet's worked examples ---

TEST_F(Delta, ReproducesTheSheetsForwardExamples) {
  const struct {
    Vector3d counts, angle_rad, position_B;
  } examples[] = {
      {{0, 0, 0}, {0.610865238198, 0.610865238198, 0.610865238198}, {0.0, 0.0, 0.134602428444}},
      {{100, 100, 100},
       {0.674455714496, 0.674455714496, 0.674455714496},
       {0.0, 0.0, 0.139321359259}},
      {{-500, -500, -500},
       {0.292912856709, 0.292912856709, 0.292912856709},
       {0.0, 0.0, 0.110754499105}},
      {{-300, -650, -420},
       {0.420093809305, 0.197527142262, 0.343785237747},
       {0.008943261911, -0.006036252787, 0.112189283513}},
      {{217, -226, 291},
       {0.748856571764, 0.467150761765, 0.795913524225},
       {0.020246830321, -0.001566710053, 0.137106230358}},
      {{456, -998, -29},
       {0.900837810116, -0.023767715254, 0.592424000072},
       {0.037290229198, -0.028302454267, 0.114221603622}},
      {{-1430, -287, 148},
       {-0.298478572861, 0.428360571223, 0.704979143119},
       {0.001969846787, 0.043933681733, 0.099246434573}},
      {{755, -96, 605},
       {1.090973334246, 0.549818380952, 0.995587619800},
       {0.030950657591, -0.014053899693, 0.148361160391}},
  };
  for (const auto& example : examples) {
    SCOPED_TRACE("counts " + std::to_string(example.counts[0]));
    const Vector3d angle_rad = kinematics_.angles_of_counts(example.counts);
    expect_near(angle_rad, example.angle_rad, kPrinted);
    const DeltaPose pose = kinematics_.forward(angle_rad);
    EXPECT_EQ(pose.status, KinematicsStatus::kOk);
    expect_near(pose.position_B, example.position_B, kPrinted);
  }
}

TEST_F(Delta, ReproducesTheSheetsInverseExamples) {
  const struct {
    Vector3d position_B, angle_rad, counts;
  } examples[] = {
      {{0, 0, 0.11},
       {0.282533201336, 0.282533201336, 0.282533201336},
       {-516.32265707, -516.32265707, -516.32265707}},
      {{0.02, -0.01, 0.12},
       {0.620778651001, 0.200581898647, 0.529684680148},
       {15.58946147, -645.19620458, -127.66150338}},
      {{-0.03, 0.025, 0.13},
       {0.306569915418, 0.978429593993, 0.655031876130},
       {-478.52342127, 578.01793161, 69.45479969}},
      {{0.04, 0.04, 0.1},
       {0.071492256087, 0.032394961966, 0.996895152082},
       {-848.19773890, -909.68067848, 607.05617627}},
      {{-0.02, -0.035, 0.15},
       {1.188145092091, 1.077181506123, 0.548179978393},
       {907.80866492, 733.31148794, -98.57649047}},
      {{0.01, 0, 0.165},
       {1.103593785320, 0.985837965005, 1.135169004666},
       {774.84644841, 589.66805823, 824.50045509}},
  };
  for (const auto& example : examples) {
    SCOPED_TRACE("x " + std::to_string(example.position_B[0]));
    const DeltaInverse inverse = kinematics_.inverse(example.position_B);
    EXPECT_EQ(inverse.status, KinematicsStatus::kOk);
    expect_near(inverse.joint_angle_rad, example.angle_rad, kPrinted);
    expect_near(inverse.counts, example.counts, kPrintedCounts);
  }
}

TEST_F(Delta, ReproducesTheSheetsTableOnTheAxis) {
  const struct {
    double z_m, angle_deg, counts, slope_m_per_rad;
  } rows[] = {
      {0.075, -18.319477, -1463.43, 0.013459}, {0.080, -11.800048, -1284.49, 0.015841},
      {0.090, -1.054972, -989.58, 0.019651},   {0.100, 8.008076, -740.83, 0.022389},
      {0.110, 16.187960, -516.32, 0.024180},   {0.120, 23.918022, -304.16, 0.025098},
      {0.125, 27.709292, -200.10, 0.025243},   {0.150, 47.243273, 336.03, 0.022768},
      {0.160, 56.136420, 580.12, 0.020038},    {0.170, 66.756141, 871.59, 0.015772},
      {0.175, 73.464848, 1055.72, 0.012652},   {0.180, 82.682577, 1308.71, 0.008015},
  };
  for (const auto& row : rows) {
    SCOPED_TRACE("z " + std::to_string(row.z_m));
    const DeltaInverse inverse = kinematics_.inverse(Vector3d(0, 0, row.z_m));
    ASSERT_EQ(inverse.status, KinematicsStatus::kOk);
    const DeltaPose pose = kinematics_.forward(inverse.joint_angle_rad);
    for (Eigen::Index leg = 0; leg < 3; ++leg) {
      EXPECT_NEAR(inverse.joint_angle_rad[leg] / kDegree, row.angle_deg, 1e-6);
      EXPECT_NEAR(inverse.counts[leg], row.counts, 0.006);
      EXPECT_NEAR(pose.jacobian_B(2, leg), row.slope_m_per_rad, 6e-7);
    }
  }
}

TEST_F(Delta, ReproducesTheSheetsJacobian) {
  const DeltaPose pose =
      kinematics_.forward(kinematics_.inverse(Vector3d(0.02, -0.01, 0.12)).joint_angle_rad);
  Matrix3d expected;
  expected << 0.017913814580, -0.049088673839, 0.043151963088,  //
      -0.064074575646, 0.011099556236, 0.046697470054,          //
      0.015457133040, 0.036493027241, 0.021170893163;
  EXPECT_LT((pose.jacobian_B - expected).cwiseAbs().maxCoeff(), kPrinted);
}

TEST_F(Delta, ReproducesTheSheetsJointTorques) {
  const struct {
    Vector3d position_B, force_B, torque_Nm;
  } examples[] = {
      {{0, 0, 0.11}, {0, 0, 1}, {0.024180165286, 0.024180165286, 0.024180165286}},
      {{0, 0, 0.11}, {1, 0, 0}, {0.015487698043, -0.052724935123, 0.037237237080}},
      {{0, 0, 0.11}, {0, 1, 0}, {-0.051939684338, 0.012557102218, 0.039382582121}},
      {{0.02, -0.01, 0.12}, {1.5, -2, 0.75}, {0.166612722942, -0.068462352799, -0.012788825604}},
      {{-0.03, 0.025, 0.13}, {-1, 0.5, -2}, {-0.125387289504, 0.088718020271, -0.078291221778}},
      {{0.04, 0.04, 0.1}, {0.3, -0.6, 1.2}, {0.067827314461, 0.022747931549, -0.038637771494}},
      {{-0.02, -0.035, 0.15}, {2.5, 1, -0.5}, {0.012081616571, -0.162085114692, 0.114963619770}},
  };
  for (const auto& example : examples) {
    SCOPED_TRACE("x " + std::to_string(example.position_B[0]));
    const DeltaPose pose =
        kinematics_.forward(kinematics_.inverse(example.position_B).joint_angle_rad);
    expect_near(DeltaKinematics::joint_torque(pose, example.force_B), example.torque_Nm, kPrinted);
  }
}

// --- properties ---

/// Calls `check(position_B)` on a grid over |x|, |y| <= 50 mm and z from 75 to 175 mm, where the
/// sheet counts 2030 of 13^3 points as reachable.
template <typename Check>
int over_workspace(const DeltaKinematics& kinematics, Check check) {
  int reachable = 0;
  for (int i = 0; i < 13; ++i) {
    for (int j = 0; j < 13; ++j) {
      for (int k = 0; k < 13; ++k) {
        const Vector3d position_B(-0.05 + 0.1 * i / 12, -0.05 + 0.1 * j / 12, 0.075 + 0.1 * k / 12);
        const DeltaInverse inverse = kinematics.inverse(position_B);
        if (inverse.status == KinematicsStatus::kUnreachable) {
          continue;
        }
        ++reachable;
        if (inverse.status == KinematicsStatus::kOk) {
          check(position_B, inverse);
        }
      }
    }
  }
  return reachable;
}

TEST_F(Delta, ForwardUndoesInverseOverTheWholeWorkspaceFromTheSpheres) {
  double worst_m = 0.0;
  int checked = 0;
  const int reachable =
      over_workspace(kinematics_, [&](const Vector3d& position_B, const DeltaInverse& inverse) {
        const DeltaPose pose = kinematics_.forward(inverse.joint_angle_rad);
        ASSERT_EQ(pose.status, KinematicsStatus::kOk) << position_B.transpose();
        worst_m = std::max(worst_m, (pose.position_B - position_B).norm());
        ++checked;
      });
  EXPECT_EQ(reachable, 2030);  // the sheet's count
  EXPECT_GT(checked, 2000);
  EXPECT_LT(worst_m, 1e-9);
}

TEST_F(Delta, ForwardFindsTheSamePoseFromWhereverItBegins) {
  constexpr unsigned kSeed = 4201;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> anywhere_m(-0.3, 0.3);
  double worst_m = 0.0;
  over_workspace(kinematics_, [&](const Vector3d& position_B, const DeltaInverse& inverse) {
    const Vector3d starts_B[] = {position_B,
                                 position_B + Vector3d(0.004, -0.003, 0.002),
                                 Vector3d(0, 0, 0.1346),
                                 Vector3d(0, 0, -0.05),
                                 Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()),
                                 {anywhere_m(random), anywhere_m(random), anywhere_m(random)}};
    for (const Vector3d& start_B : starts_B) {
      const DeltaPose pose = kinematics_.forward(inverse.joint_angle_rad, start_B);
      ASSERT_EQ(pose.status, KinematicsStatus::kOk)
          << position_B.transpose() << " from " << start_B.transpose();
      worst_m = std::max(worst_m, (pose.position_B - position_B).norm());
    }
  });
  EXPECT_LT(worst_m, 1e-9);
}

TEST_F(Delta, StartsWithinFourteenMillimetresInTheForceBox) {
  double worst_m = 0.0;
  over_workspace(kinematics_, [&](const Vector3d& position_B, const DeltaInverse& inverse) {
    if (position_B.head<2>().cwiseAbs().maxCoeff() <= 0.042 && position_B.z() >= 0.083 &&
        position_B.z() <= 0.160) {
      worst_m = std::max(worst_m,
                         (kinematics_.sphere_start(inverse.joint_angle_rad) - position_B).norm());
    }
  });
  EXPECT_GT(worst_m, 0.005);
  EXPECT_LT(worst_m, 0.0145);
}

TEST_F(Delta, LegsKeepTheirLengths) {
  // Straight from the mechanism: knee and platform joint, built with vectors, are a shin apart.
  const profiles::DeviceProfile::Delta g = falcon_sheet_geometry();
  over_workspace(kinematics_, [&](const Vector3d& position_B, const DeltaInverse& inverse) {
    for (std::size_t leg = 0; leg < 3; ++leg) {
      const double phi = g.leg_azimuth_rad[leg];
      const double theta = inverse.joint_angle_rad[static_cast<Eigen::Index>(leg)];
      const Vector3d u(std::cos(phi), std::sin(phi), 0.0);
      const Vector3d v(-std::sin(phi), std::cos(phi), 0.0);
      const Vector3d w = Vector3d::UnitZ();
      const Vector3d knee = g.base_offset_u_m * u + g.base_offset_v_m * v +
                            g.thigh_m * (std::cos(theta) * u + std::sin(theta) * w);
      const Vector3d joint = position_B + g.platform_offset_u_m * u + g.platform_offset_v_m * v;
      const Vector3d shin = joint - knee;
      const double across_m = shin.dot(v);
      const double along_m = std::hypot(shin.dot(u), shin.dot(w)) - g.knee_end_m - g.platform_end_m;
      ASSERT_NEAR(std::hypot(across_m, along_m), g.shin_m, 1e-12) << position_B.transpose();
    }
  });
}

TEST_F(Delta, JacobianMatchesCentralDifferencesOfTheInverse) {
  constexpr double kStep_m = 1e-6;
  int checked = 0;
  for (const double x_m : {-0.04, -0.013, 0.0, 0.022, 0.04}) {
    for (const double y_m : {-0.04, -0.017, 0.0, 0.011, 0.04}) {
      for (const double z_m : {0.085, 0.110, 0.135, 0.160}) {
        const Vector3d position_B(x_m, y_m, z_m);
        const DeltaInverse inverse = kinematics_.inverse(position_B);
        if (inverse.status != KinematicsStatus::kOk) {
          continue;
        }
        Matrix3d rates_rad_per_m;
        for (Eigen::Index axis = 0; axis < 3; ++axis) {
          const Vector3d step_B = kStep_m * Vector3d::Unit(axis);
          rates_rad_per_m.col(axis) = (kinematics_.inverse(position_B + step_B).joint_angle_rad -
                                       kinematics_.inverse(position_B - step_B).joint_angle_rad) /
                                      (2.0 * kStep_m);
        }
        const DeltaPose pose = kinematics_.forward(inverse.joint_angle_rad);
        ASSERT_EQ(pose.status, KinematicsStatus::kOk);
        const Matrix3d expected = rates_rad_per_m.inverse();
        // The difference quotient's own error is 1e-12 of the third derivative.
        EXPECT_LT((pose.jacobian_B - expected).norm(), 1e-6 * expected.norm())
            << position_B.transpose();
        ++checked;
      }
    }
  }
  EXPECT_GT(checked, 90);
}

TEST_F(Delta, PowerAtTheJointsIsPowerAtTheTip) {
  constexpr unsigned kSeed = 4202;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int i = 0; i < 200; ++i) {
    const Vector3d position_B(0.04 * unit(random), 0.04 * unit(random),
                              0.1225 + 0.03 * unit(random));
    const Vector3d velocity_B(unit(random), unit(random), unit(random));
    const Vector3d force_B(8 * unit(random), 8 * unit(random), 8 * unit(random));
    constexpr double kStep_s = 1e-6;
    const DeltaInverse before = kinematics_.inverse(position_B - kStep_s * velocity_B);
    const DeltaInverse after = kinematics_.inverse(position_B + kStep_s * velocity_B);
    const Vector3d rate_rad_per_s =
        (after.joint_angle_rad - before.joint_angle_rad) / (2.0 * kStep_s);
    const DeltaPose pose = kinematics_.forward(kinematics_.inverse(position_B).joint_angle_rad);
    const Vector3d torque_Nm = DeltaKinematics::joint_torque(pose, force_B);
    EXPECT_NEAR(torque_Nm.dot(rate_rad_per_s), force_B.dot(velocity_B), 1e-6);
  }
}

// --- the ends ---

TEST_F(Delta, IsUnreachableBeyondItsReach) {
  EXPECT_EQ(kinematics_.inverse(Vector3d(0, 0, 0.186)).status, KinematicsStatus::kUnreachable);
  EXPECT_EQ(kinematics_.inverse(Vector3d(0.2, 0, 0.12)).status, KinematicsStatus::kUnreachable);
  EXPECT_EQ(kinematics_.inverse(Vector3d(0, -0.2, 0.12)).status, KinematicsStatus::kUnreachable);
}

TEST_F(Delta, IsSingularWhereArmAndShinAlign) {
  // On the axis, reach ends where the thigh and the shin of each leg are one line.
  double low_m = 0.18, high_m = 0.186;
  for (int i = 0; i < 60; ++i) {
    const double middle_m = 0.5 * (low_m + high_m);
    (kinematics_.inverse(Vector3d(0, 0, middle_m)).status == KinematicsStatus::kUnreachable
         ? high_m
         : low_m) = middle_m;
  }
  EXPECT_NEAR(low_m, 0.184, 1e-3);  // the sheet: unreachable beyond about 0.184
  EXPECT_EQ(kinematics_.inverse(Vector3d(0, 0, low_m)).status, KinematicsStatus::kSingular);
  EXPECT_EQ(kinematics_.inverse(Vector3d(0, 0, low_m - 0.002)).status, KinematicsStatus::kOk);
}

TEST_F(Delta, ASingularPoseCarriesNoForce) {
  bool met = false;
  for (double angle_deg = 85.0; angle_deg < 110.0; angle_deg += 0.05) {
    const DeltaPose pose = kinematics_.forward(Vector3d::Constant(angle_deg * kDegree));
    if (pose.status == KinematicsStatus::kSingular) {
      met = true;
      EXPECT_EQ(DeltaKinematics::joint_torque(pose, Vector3d(1, 2, 3)), Vector3d::Zero());
    }
  }
  EXPECT_TRUE(met);
}

TEST_F(Delta, AnglesThatNoPoseHasAreUnreachable) {
  // Legs 2 and 3 folded far in, leg 1 far out: the spheres of the knees have no common point near.
  const DeltaPose pose = kinematics_.forward(Vector3d(1.5, -1.9, 3.0));
  EXPECT_TRUE(pose.status == KinematicsStatus::kUnreachable ||
              pose.status == KinematicsStatus::kSingular)
      << to_string(pose.status);
  EXPECT_EQ(pose.jacobian_B, Matrix3d::Zero());
}

TEST_F(Delta, IsOutOfRangeBeyondTheStopsAndTheirTolerance) {
  profiles::DeviceProfile::Delta geometry = falcon_sheet_geometry();
  geometry.joint_min_rad = -0.3;
  geometry.joint_max_rad = 1.2;
  const DeltaKinematics stopped(geometry);
  EXPECT_EQ(stopped.forward(Vector3d::Constant(1.24)).status, KinematicsStatus::kOk);
  EXPECT_EQ(stopped.forward(Vector3d::Constant(1.26)).status, KinematicsStatus::kOutOfRange);
  EXPECT_EQ(stopped.forward(Vector3d(0.6, -0.36, 0.6)).status, KinematicsStatus::kOutOfRange);
  EXPECT_EQ(stopped.inverse(Vector3d(0, 0, 0.178)).status, KinematicsStatus::kOutOfRange);
}

TEST_F(Delta, NumbersThatAreNoneHaveNoPose) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(kinematics_.forward(Vector3d(0, kNan, 0)).status, KinematicsStatus::kNotFinite);
  EXPECT_EQ(kinematics_.forward(Vector3d(0, 0, kInfinity)).status, KinematicsStatus::kNotFinite);
  EXPECT_EQ(kinematics_.inverse(Vector3d(kNan, 0, 0.12)).status, KinematicsStatus::kNotFinite);
  EXPECT_EQ(kinematics_.forward(Vector3d(0, kNan, 0)).jacobian_B, Matrix3d::Zero());
}

}  // namespace
}  // namespace forcegrid::driver
