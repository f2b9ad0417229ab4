// SPDX-License-Identifier: Apache-2.0
#include "driver/kinematics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "driver/device.h"
#include "driver/kinematics_json.h"
#include "rt/vectors.h"

namespace forcegrid::driver {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using profiles::DeviceProfile;
using profiles::load_device_profile;

constexpr double kPrinted = 1e-12;       // the sheets print 12 decimals
constexpr double kPrintedCounts = 1e-6;  // and 6 of counts
constexpr std::array<const char*, 6> kProfiles = {"woodenhaptics_v2015", "woodenhaptics_v2019",
                                                  "polhem_v1",           "vintage",
                                                  "phantom_desktop",     "phantom_desktop_wrist"};

void expect_near(const Vector3d& actual, const Vector3d& expected, double tolerance) {
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(actual[i], expected[i], tolerance) << "element " << i;
  }
}

// --- worked examples of the sheets ---

struct ForwardExample {
  const char* profile;
  Vector3d counts;
  Vector3d joint_angle_rad;
  Vector3d position_D;
};

TEST(ArmKinematics, ReproducesTheSheetsForwardExamples) {
  const ForwardExample examples[] = {
      {"woodenhaptics_v2015", {0, 0, 6000}, {0.0, 0.0, 1.570796326795}, {0.025, 0.0, 0.205}},
      {"woodenhaptics_v2015",
       {1000, 2000, 6500},
       {0.196349540849, 0.523598775598, 1.701696020694},
       {0.118767150201, 0.067384975837, 0.209514124870}},
      {"woodenhaptics_v2015",
       {-1500, 1200, 5200},
       {-0.294524311274, 0.314159265359, 1.361356816556},
       {0.069947798294, -0.087954703032, 0.144028221590}},
      {"woodenhaptics_v2015",
       {3000, -800, 7000},
       {0.589048622548, -0.209439510239, 1.832595714594},
       {-0.058670008643, 0.107797253880, 0.263930924201}},
      {"woodenhaptics_v2015",
       {-2500, 3500, 5000},
       {-0.490873852123, 0.916297857297, 1.308996938996},
       {0.132141690961, -0.188223655251, 0.061385426897}},
      {"woodenhaptics_v2015",
       {450, -321, 6789},
       {0.088357293382, -0.084037603484, 1.777356043768},
       {0.001716127843, 0.019641377062, 0.254524560829}},
      {"polhem_v1", {0, 0, -5000}, {0.0, 0.0, 1.570796326795}, {-0.007, 0.0, 0.132}},
      {"polhem_v1",
       {1200, -1500, -5600},
       {-0.209439510239, 0.471238898038, 1.759291886010},
       {0.065057445977, -0.043586305662, 0.137956850049}},
      {"polhem_v1",
       {-2200, 900, -4300},
       {0.383972435439, -0.282743338823, 1.350884841044},
       {-0.064664015287, 0.030437713573, 0.096078050202}},
      {"vintage",
       {0, 4000, 9000},
       {0.0, 0.815998091842, 1.835995706643},
       {0.068605061175, 0.0, 0.179904945155}},
      {"vintage",
       {2500, -1000, 10500},
       {0.436332312999, -0.203999522960, 2.141994991084},
       {-0.079945040247, 0.028004087643, 0.251690225464}},
      {"vintage",
       {-3333, 2222, 8888},
       {-0.581718239690, 0.453286940018, 1.813147760072},
       {0.001336785235, -0.092946886848, 0.206942162248}},
      {"phantom_desktop", {0, 0, 0}, {0.0, 0.0, 0.0}, {0.020, 0.0, -0.020}},
      {"phantom_desktop",
       {1000, 0, 0},
       {0.170442309765, 0.0, 0.0},
       {0.018067737097, 0.022618595807, -0.020}},
      {"phantom_desktop",
       {0, 1000, 0},
       {0.0, 0.170442309765, 0.0},
       {0.018067737097, 0.0, 0.002618595807}},
      {"phantom_desktop",
       {0, 0, 1000},
       {0.0, 0.0, 0.170442309765},
       {0.042618595807, 0.0, -0.018067737097}},
      {"phantom_desktop",
       {2000, -1500, 1200},
       {0.340884619530, -0.255663464648, 0.204530771718},
       {0.033767867969, 0.052187489339, -0.050943035351}},
      {"phantom_desktop",
       {-3500, 2500, -1000},
       {-0.596548084178, 0.426105774413, -0.170442309765},
       {-0.031608513720, -0.055509103824, 0.037049542739}},
      {"phantom_desktop",
       {1234, -2345, 3456},
       {0.210325810250, -0.399687216399, 0.589048622548},
       {0.079235363235, 0.041113716460, -0.049416989036}},
      {"phantom_desktop",
       {-4321, 3210, 2109},
       {-0.736481220495, 0.547119814346, 0.359462831295},
       {0.005771455827, -0.108002381793, 0.057895564545}},
  };
  for (const ForwardExample& example : examples) {
    SCOPED_TRACE(std::string(example.profile) + " at counts " + std::to_string(example.counts[0]));
    const ArmKinematics kinematics(load_device_profile(example.profile));
    const ArmPose pose = kinematics.forward(example.counts);
    EXPECT_EQ(pose.status, KinematicsStatus::kOk);
    expect_near(pose.joint_angle_rad, example.joint_angle_rad, kPrinted);
    expect_near(pose.position_D, example.position_D, kPrinted);
  }
}

struct ForceExample {
  const char* profile;
  Vector3d counts;
  Vector3d force_D;
  Vector3d joint_torque_Nm;
  Vector3d current_A;
  std::array<std::int16_t, 3> report_mA;
};

const ForceExample kForceExamples[] = {
    {"woodenhaptics_v2015",
     {0, 0, 6000},
     {0, 0, 1},
     {0, 0, 0.245},
     {0, 0, 0.788288288288},
     {0, 0, 788}},
    {"woodenhaptics_v2015",
     {0, 0, 6000},
     {1, 0, 0},
     {0, 0.205, 0},
     {0, 0.659588159588, 0},
     {0, 659, 0}},
    {"woodenhaptics_v2015",
     {1000, 2000, 6500},
     {1, -2, 0.5},
     {-0.744919276239, 0.053603116831, 0.102565098817},
     {-1.797585126060, 0.172468200873, 0.330003535446},
     {-1797, 172, 330}},
    {"woodenhaptics_v2015",
     {-1500, 1200, 5200},
     {-0.75, 0.25, 1.5},
     {0.006520922300, -0.249100221465, 0.319213855073},
     {0.015735816360, -0.801480764044, 1.027071605768},
     {15, -801, 1027}},
    {"woodenhaptics_v2015",
     {3000, -800, 7000},
     {2, 2, -2},
     {0.107065474953, 0.471015382463, -0.649209895742},
     {0.258362632608, 1.515493508567, -2.088834928383},
     {258, 1515, -2088}},
    {"woodenhaptics_v2019",
     {1000, 2000, 6500},
     {1, -2, 0.5},
     {-0.744919276239, 0.053603116831, 0.102565098817},
     {-0.145038799891, 0.074078381470, 0.141742812074},
     {-145, 74, 141}},
    {"woodenhaptics_v2019",
     {-1500, 1200, 5200},
     {-0.75, 0.25, 1.5},
     {0.006520922300, -0.249100221465, 0.319213855073},
     {0.001269649980, -0.344251273445, 0.441146842278},
     {1, -344, 441}},
    {"woodenhaptics_v2019",
     {3000, -800, 7000},
     {2, 2, -2},
     {0.107065474953, 0.471015382463, -0.649209895742},
     {0.020846081572, 0.650933364376, -0.897194438559},
     {20, 650, -897}},
    {"polhem_v1",
     {1200, -1500, -5600},
     {1, -2, 0.5},
     {-0.366528586292, 0.176617306251, 0.030581954856},
     {0.378488833429, -0.328284955858, -0.056843782260},
     {378, -328, -56}},
    {"phantom_desktop", {0, 0, 0}, {0, 0, 1}, {0, 0.13335, 0}, {0, 0.633190883191, 0}, {0, 633, 0}},
    {"phantom_desktop", {0, 0, 0}, {1, 0, 0}, {0, 0, 0.13335}, {0, 0, 0.633190883191}, {0, 0, 633}},
    {"phantom_desktop", {0, 0, 0}, {0, 1, 0}, {0.13335, 0, 0}, {0.633190883191, 0, 0}, {633, 0, 0}},
    {"phantom_desktop",
     {2000, -1500, 1200},
     {1, -2, 0.5},
     {-0.346423225276, 0.073741593252, 0.049294685293},
     {-1.644934592954, 0.350150015440, 0.234067831399},
     {-1644, 350, 234}},
    {"phantom_desktop",
     {-3500, 2500, -1000},
     {-1.5, 0.5, 2.5},
     {-0.042392912596, 0.387443644521, -0.256539940389},
     {-0.201295881271, 1.839713411780, -1.218138368421},
     {-201, 1839, -1218}},
    {"phantom_desktop",
     {1234, -2345, 3456},
     {0.4, 1.75, -1},
     {0.320578899077, -0.083582073243, 0.009798041593},
     {1.522216994666, -0.396875941325, 0.046524414022},
     {1522, -396, 46}},
    {"phantom_desktop",
     {-4321, 3210, 2109},
     {3, -2, 4},
     {0.085764233723, 0.208163217994, 0.632753250852},
     {0.407237577033, 0.988429335206, 3.004526357323},
     {407, 988, 3004}},
};

TEST(ArmKinematics, ReproducesTheSheetsForceExamplesDownToTheReport) {
  for (const ForceExample& example : kForceExamples) {
    SCOPED_TRACE(std::string(example.profile) + " at counts " + std::to_string(example.counts[0]));
    const ArmKinematics kinematics(load_device_profile(example.profile));
    const ArmPose pose = kinematics.forward(example.counts);
    const Vector3d torque_Nm = ArmKinematics::joint_torque(pose, example.force_D);
    expect_near(torque_Nm, example.joint_torque_Nm, kPrinted);
    const Vector3d current_A = kinematics.motor_current_A(torque_Nm);
    expect_near(current_A, example.current_A, kPrinted);
    const ReportCurrent report = kinematics.report_current(current_A);
    EXPECT_TRUE(report.finite);
    EXPECT_FALSE(report.clamped);
    EXPECT_EQ(report.current_mA, example.report_mA);
  }
}

TEST(ArmKinematics, ReproducesTheSheetsJacobians) {
  const ArmPose woody =
      ArmKinematics(load_device_profile("woodenhaptics_v2015")).forward(Vector3d(1000, 2000, 6500));
  Matrix3d expected;
  expected << -0.067384975837, 0.174123918540, -0.031364451169,  //
      0.338767150201, 0.034635400854, -0.006238777234,           //
      0.0, -0.102500000000, 0.242903991037;
  EXPECT_LT((woody.jacobian_D - expected).cwiseAbs().maxCoeff(), kPrinted);

  // The PHANTOM sheet prints it in frame P: (x, y, z)_D = (z, x, y)_P.
  const ArmPose phantom =
      ArmKinematics(load_device_profile("phantom_desktop")).forward(Vector3d(2000, -1500, 1200));
  Matrix3d in_P;
  in_P << 0.147117867969, 0.011274147926, 0.043652454209,  //
      0.0, 0.129015555171, 0.027084416383,                 //
      -0.052187489339, 0.031782111518, 0.123057385519;
  EXPECT_LT((phantom.jacobian_D.row(0) - in_P.row(2)).cwiseAbs().maxCoeff(), kPrinted);
  EXPECT_LT((phantom.jacobian_D.row(1) - in_P.row(0)).cwiseAbs().maxCoeff(), kPrinted);
  EXPECT_LT((phantom.jacobian_D.row(2) - in_P.row(1)).cwiseAbs().maxCoeff(), kPrinted);
}

TEST(ArmKinematics, ReproducesTheSheetsInverseExamples) {
  struct {
    const char* profile;
    Vector3d position_D, joint_angle_rad, counts;
  } const examples[] = {
      {"woodenhaptics_v2015",
       {0, 0, 0},
       {0.0, 0.343759299893, 0.663598258687},
       {0.0, 1313.063803, 2534.758634}},
      {"woodenhaptics_v2015",
       {0.05, -0.03, 0.02},
       {-0.110657221174, 0.453822576025, 0.836040572288},
       {-563.572600, 1733.474550, 3193.439753}},
      {"woodenhaptics_v2015",
       {-0.04, 0.06, -0.05},
       {0.321750554397, 0.515330544382, 0.370491543765},
       {1638.662118, 1968.417683, 1415.173454}},
      {"phantom_desktop",
       {0, 0, 0},
       {0.0, 0.140578876871, -0.140578876871},
       {0.0, 824.788617, -824.788617}},
      {"phantom_desktop",
       {0.03, -0.05, 0.04},
       {-0.335602392070, 0.436326466981, 0.234333968368},
       {-1969.008708, 2559.965701, 1374.857972}},
      {"phantom_desktop",
       {-0.06, 0.08, -0.06},
       {0.982649506346, -0.331518421211, -0.226388609935},
       {5765.290952, -1945.047692, -1328.241856}},
      {"phantom_desktop",
       {0.06, -0.08, 0.06},
       {-0.432371193105, 0.460346448950, 0.565476260226},
       {-2536.759762, 2700.893045, 3317.698880}},
  };
  for (const auto& example : examples) {
    SCOPED_TRACE(example.profile);
    const ArmInverse inverse =
        ArmKinematics(load_device_profile(example.profile)).inverse(example.position_D);
    EXPECT_EQ(inverse.status, KinematicsStatus::kOk);
    expect_near(inverse.joint_angle_rad, example.joint_angle_rad, kPrinted);
    expect_near(inverse.counts, example.counts, kPrintedCounts);
  }
}

// --- physics ---

class EachArm : public testing::TestWithParam<const char*> {
 protected:
  DeviceProfile profile_ = load_device_profile(GetParam());
  ArmKinematics kinematics_{profile_};

  /// Calls `check(position_D)` at the nodes of a grid over the force box.
  template <typename Check>
  void over_the_box(int nodes, Check check) const {
    for (int i = 0; i < nodes; ++i) {
      for (int j = 0; j < nodes; ++j) {
        for (int k = 0; k < nodes; ++k) {
          Vector3d position_D;
          const int node[3] = {i, j, k};
          for (std::size_t axis = 0; axis < 3; ++axis) {
            const double low = profile_.limits.workspace_min_m[axis];
            const double high = profile_.limits.workspace_max_m[axis];
            position_D[static_cast<Eigen::Index>(axis)] =
                low + (high - low) * node[axis] / (nodes - 1);
          }
          check(position_D);
        }
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Profiles, EachArm, testing::ValuesIn(kProfiles),
                         [](const auto& arm) { return std::string(arm.param); });

TEST_P(EachArm, ReachesItsWholeForceBoxWithinItsStopsAndForwardUndoesInverse) {
  constexpr double kRounding_m = 1e-12;
  over_the_box(9, [&](const Vector3d& position_D) {
    const ArmInverse inverse = kinematics_.inverse(position_D);
    ASSERT_EQ(inverse.status, KinematicsStatus::kOk) << position_D.transpose();
    const ArmPose pose = kinematics_.forward(inverse.counts);
    EXPECT_EQ(pose.status, KinematicsStatus::kOk);
    EXPECT_LT((pose.position_D - position_D).norm(), kRounding_m);
    for (Eigen::Index i = 0; i < 3; ++i) {
      const auto axis = static_cast<std::size_t>(i);
      EXPECT_GE(inverse.joint_angle_rad[i], profile_.kinematics.joint_min_rad[axis]);
      EXPECT_LE(inverse.joint_angle_rad[i], profile_.kinematics.joint_max_rad[axis]);
    }
  });
}

TEST_P(EachArm, HoldsTheBoxThatTheScenesNeed) {
  const std::array<double, 3> needed_m = {0.060, 0.080, 0.060};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_LE(profile_.limits.workspace_min_m[i], -needed_m[i]);
    EXPECT_GE(profile_.limits.workspace_max_m[i], needed_m[i]);
  }
}

TEST_P(EachArm, HasAJacobianThatEqualsCentralDifferences) {
  constexpr double kStep_rad = 1e-5;
  constexpr double kTolerance_m_per_rad = 1e-9;  // third derivative * step^2, and rounding / step
  over_the_box(5, [&](const Vector3d& position_D) {
    const ArmPose pose =
        kinematics_.forward_from_angles(kinematics_.inverse(position_D).joint_angle_rad);
    for (Eigen::Index joint = 0; joint < 3; ++joint) {
      const Vector3d step_rad = kStep_rad * Vector3d::Unit(joint);
      const Vector3d difference =
          (kinematics_.forward_from_angles(pose.joint_angle_rad + step_rad).position_D -
           kinematics_.forward_from_angles(pose.joint_angle_rad - step_rad).position_D) /
          (2.0 * kStep_rad);
      EXPECT_LT((difference - pose.jacobian_D.col(joint)).cwiseAbs().maxCoeff(),
                kTolerance_m_per_rad);
    }
  });
}

TEST_P(EachArm, NeitherMakesNorLosesPowerBetweenTipAndJoints) {
  constexpr unsigned kSeed = 20240;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr double kStep_s = 1e-6;
  over_the_box(4, [&](const Vector3d& position_D) {
    const Vector3d force_D(uniform(random), uniform(random), uniform(random));
    const Vector3d speed_rad_per_s(uniform(random), uniform(random), uniform(random));
    const ArmPose pose =
        kinematics_.forward_from_angles(kinematics_.inverse(position_D).joint_angle_rad);
    const Vector3d tip_velocity_D =
        (kinematics_.forward_from_angles(pose.joint_angle_rad + kStep_s * speed_rad_per_s)
             .position_D -
         kinematics_.forward_from_angles(pose.joint_angle_rad - kStep_s * speed_rad_per_s)
             .position_D) /
        (2.0 * kStep_s);
    const double tip_power_W = force_D.dot(tip_velocity_D);
    const double joint_power_W = ArmKinematics::joint_torque(pose, force_D).dot(speed_rad_per_s);
    EXPECT_NEAR(tip_power_W, joint_power_W, 1e-8);
  });
}

TEST_P(EachArm, HoldsGravityWithTheSlopeOfThePotentialEnergy) {
  constexpr double kStep_rad = 1e-5;
  constexpr double kTolerance_Nm = 1e-9;  // third derivative * step^2, and rounding / step
  over_the_box(4, [&](const Vector3d& position_D) {
    const Vector3d q = kinematics_.inverse(position_D).joint_angle_rad;
    const Vector3d torque_Nm = kinematics_.gravity_torque(q);
    for (Eigen::Index joint = 0; joint < 3; ++joint) {
      const Vector3d step_rad = kStep_rad * Vector3d::Unit(joint);
      const double slope_Nm = (kinematics_.potential_energy_J(q + step_rad) -
                               kinematics_.potential_energy_J(q - step_rad)) /
                              (2.0 * kStep_rad);
      EXPECT_NEAR(torque_Nm[joint], slope_Nm, kTolerance_Nm);
    }
  });
}

TEST_P(EachArm, RaisesItsPotentialEnergyByTheLinksWeightTimesTheirHeight) {
  // The links' centres from the linkage itself: the shoulder is at height L_a.
  const auto& gravity = profile_.gravity;
  const auto& k = profile_.kinematics;
  over_the_box(3, [&](const Vector3d& position_D) {
    const Vector3d q = kinematics_.inverse(position_D).joint_angle_rad;
    const double theta_b = k.linkage_offset_rad[1] + k.linkage_sign[1] * q[1];
    const double elbow_height_m = k.link_length_m[1] * std::cos(theta_b);
    const double tip_height_m = position_D[2] + k.origin_m[2] - k.link_length_m[0];
    // The centre of link c divides elbow and tip in the ratio of its length.
    const double center_c_height_m = elbow_height_m + gravity.link_c_center_m / k.link_length_m[2] *
                                                          (tip_height_m - elbow_height_m);
    const double center_b_height_m = gravity.link_b_center_m / k.link_length_m[1] * elbow_height_m;
    EXPECT_NEAR(kinematics_.potential_energy_J(q),
                gravity.acceleration_m_per_s2 * (gravity.link_b_mass_kg * center_b_height_m +
                                                 gravity.link_c_mass_kg * center_c_height_m),
                1e-12);
  });
}

TEST_P(EachArm, GivesBackTheTorqueOfACurrent) {
  const Vector3d torque_Nm(0.3, -0.2, 0.1);
  expect_near(kinematics_.joint_torque_of_current(kinematics_.motor_current_A(torque_Nm)),
              torque_Nm, 1e-15);
}

TEST(ArmKinematics, MovesEachAxisTheWayItsCounterCounts) {
  const ArmKinematics woody(load_device_profile("woodenhaptics_v2015"));
  const ArmPose rest = woody.forward(Vector3d(0, 0, 6000));
  EXPECT_GT(woody.forward(Vector3d(100, 0, 6000)).position_D.y(), rest.position_D.y());
  EXPECT_GT(woody.forward(Vector3d(0, 100, 6000)).position_D.x(), rest.position_D.x());
  EXPECT_GT(woody.forward(Vector3d(0, 0, 6100)).position_D.z(), rest.position_D.z());
  const ArmKinematics polhem(load_device_profile("polhem_v1"));
  const ArmPose polhem_rest = polhem.forward(Vector3d(0, 0, -5000));
  EXPECT_LT(polhem.forward(Vector3d(100, 0, -5000)).position_D.y(), polhem_rest.position_D.y());
  EXPECT_LT(polhem.forward(Vector3d(0, 0, -4900)).position_D.z(), polhem_rest.position_D.z());
}

// --- statuses ---

TEST(ArmKinematics, CallsPositionsBeyondTheReachUnreachable) {
  const ArmKinematics kinematics(load_device_profile("woodenhaptics_v2015"));
  // Reach from the shoulder at (-0.22, 0, 0): 0.45 m out, 0.04 m in.
  EXPECT_EQ(kinematics.inverse(Vector3d(0.2301, 0, 0)).status, KinematicsStatus::kUnreachable);
  EXPECT_EQ(kinematics.inverse(Vector3d(-0.1801, 0, 0)).status, KinematicsStatus::kUnreachable);
  EXPECT_EQ(kinematics.inverse(Vector3d(1e300, 1e300, 0)).status, KinematicsStatus::kUnreachable);
  EXPECT_EQ(kinematics.inverse(Vector3d(10, 0, 0)).counts, Vector3d::Zero());
}

TEST(ArmKinematics, CallsTheBaseAxisAndTheEndsOfTheReachSingular) {
  const ArmKinematics kinematics(load_device_profile("woodenhaptics_v2015"));
  EXPECT_EQ(kinematics.inverse(Vector3d(-0.22, 0, 0.3)).status, KinematicsStatus::kSingular);
  EXPECT_EQ(kinematics.inverse(Vector3d(0.229999, 0, 0)).status, KinematicsStatus::kSingular);
  // Power-up counters of a real device, before calibration: folded.
  EXPECT_EQ(kinematics.forward(Vector3d(0, 0, 0)).status, KinematicsStatus::kSingular);
  // Stretched (theta_b + theta_c = pi), and elbow flipped (negative).
  EXPECT_EQ(kinematics.forward_from_angles(Vector3d(0, 1.0, std::numbers::pi - 1.0)).status,
            KinematicsStatus::kSingular);
  EXPECT_EQ(kinematics.forward_from_angles(Vector3d(0, 0.5, -0.7)).status,
            KinematicsStatus::kSingular);
}

TEST(ArmKinematics, CallsAPoseBeyondTheStopsOutOfRangeButSaysWhereItIs) {
  const ArmKinematics kinematics(load_device_profile("woodenhaptics_v2015"));
  const ArmPose pose = kinematics.forward(Vector3d(8000, 2000, 6500));  // a yaw of 90 degrees
  EXPECT_EQ(pose.status, KinematicsStatus::kOutOfRange);
  EXPECT_NEAR(pose.position_D.x(), -0.22, kPrinted);
}

TEST(ArmKinematics, TurnsNanAndInfinityIntoAStatusAndZeros) {
  const ArmKinematics kinematics(load_device_profile("vintage"));
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    const ArmPose pose = kinematics.forward(Vector3d(0, bad, 0));
    EXPECT_EQ(pose.status, KinematicsStatus::kNotFinite);
    EXPECT_EQ(pose.position_D, Vector3d::Zero());
    EXPECT_EQ(pose.jacobian_D, Matrix3d::Zero());
    EXPECT_EQ(kinematics.inverse(Vector3d(bad, 0, 0)).status, KinematicsStatus::kNotFinite);
    EXPECT_EQ(kinematics.gravity_torque(Vector3d(0, 0, bad)), Vector3d::Zero());
    const ReportCurrent report = kinematics.report_current(Vector3d(1.0, bad, 1.0));
    EXPECT_FALSE(report.finite);
    EXPECT_EQ(report.current_mA, (std::array<std::int16_t, 3>{0, 0, 0}));
  }
}

TEST(AnglePerCount, IsWhatACountTurnsTheJointByWhateverItsSign) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "polhem_v1", "vintage"}) {
    const auto profile = load_device_profile(name);
    const Vector3d counts(-1000, 2000, 3000);
    const Vector3d turned_rad = ArmKinematics(profile).forward(counts).joint_angle_rad;
    const Eigen::Array3d expected_rad = (turned_rad.array() / counts.array()).abs();
    EXPECT_TRUE(angle_per_count_rad(profile).isApprox(expected_rad, 1e-12)) << name;
  }
  const auto falcon = load_device_profile("falcon");
  EXPECT_EQ(angle_per_count_rad(falcon)[2], falcon.delta.encoder_rad_per_count);
}

// --- the command's JSON ---

TEST(KinematicsJson, AgreesWithTheSheetsForceExamples) {
  for (const ForceExample& example : kForceExamples) {
    const auto json = nlohmann::json::parse(
        kinematics_json_from_counts(load_device_profile(example.profile),
                                    rt::to_array(example.counts), rt::to_array(example.force_D)));
    EXPECT_EQ(json.at("profile"), example.profile);
    EXPECT_EQ(json.at("frame"), "device");
    EXPECT_EQ(json.at("status"), "ok");
    EXPECT_EQ(json.at("report_mA"), example.report_mA);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      EXPECT_NEAR(json.at("joint_torque_Nm").at(i), example.joint_torque_Nm[axis], kPrinted);
      EXPECT_NEAR(json.at("current_A").at(i), example.current_A[axis], kPrinted);
    }
  }
}

TEST(KinematicsJson, GivesTheJacobianByRowsAndThePositionOfTheSheet) {
  const auto json = nlohmann::json::parse(
      kinematics_json_from_counts(load_device_profile("woodenhaptics_v2015"), {1000, 2000, 6500}));
  EXPECT_NEAR(json.at("jacobian_m_per_rad").at(0).at(1), 0.174123918540, kPrinted);
  EXPECT_NEAR(json.at("jacobian_m_per_rad").at(1).at(0), 0.338767150201, kPrinted);
  EXPECT_NEAR(json.at("position_m").at(2), 0.209514124870, kPrinted);
  EXPECT_NEAR(json.at("joint_angles_rad").at(2), 1.701696020694, kPrinted);
}

TEST(KinematicsJson, InvertsAPosition) {
  const auto json = nlohmann::json::parse(kinematics_json_from_position(
      load_device_profile("woodenhaptics_v2015"), {0.05, -0.03, 0.02}));
  EXPECT_NEAR(json.at("counts").at(0), -563.572600, kPrintedCounts);
  EXPECT_NEAR(json.at("counts").at(2), 3193.439753, kPrintedCounts);
  EXPECT_NEAR(json.at("position_m").at(1), -0.03, kPrinted);
}

TEST(KinematicsJson, RefusesWhatHasNoAnswerAndSaysWhy) {
  const DeviceProfile profile = load_device_profile("woodenhaptics_v2015");
  const auto error_of = [](auto call) -> std::string {
    try {
      call();
    } catch (const DeviceError& error) {
      return error.what();
    }
    ADD_FAILURE() << "accepted";
    return "";
  };
  using testing::HasSubstr;
  EXPECT_THAT(error_of([&] {
                kinematics_json_from_counts(profile, {0, 0, 0});
              }),
              HasSubstr("counts [0.0,0.0,0.0]: singular"));
  EXPECT_THAT(error_of([&] {
                kinematics_json_from_position(profile, {2, 0, 0});
              }),
              HasSubstr("out of reach"));
  EXPECT_THAT(error_of([&] {
                kinematics_json_from_position(profile, {-0.22, 0, 0.3});
              }),
              HasSubstr("singular"));
  EXPECT_THAT(error_of([&] {
                kinematics_json_from_counts(profile, {std::nan(""), 0, 0});
              }),
              HasSubstr("counts: not finite"));
  EXPECT_THAT(error_of([&] {
                kinematics_json_from_counts(profile, {0, 0, 6000}, {0, INFINITY, 0});
              }),
              HasSubstr("force: not finite"));
}

}  // namespace
}  // namespace forcegrid::driver
