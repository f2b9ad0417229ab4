// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/arm_model.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;

profiles::DeviceProfile frictionless(const char* name) {
  auto profile = profiles::load_device_profile(name);
  profile.dynamics.coulomb_friction_Nm = {};
  profile.dynamics.viscous_friction_Nm_s_per_rad = {};
  return profile;
}

profiles::DeviceProfile without_stops(profiles::DeviceProfile profile) {
  profile.kinematics.joint_min_rad.fill(-1e3);
  profile.kinematics.joint_max_rad.fill(1e3);
  profile.kinematics.elbow_min_rad = -1e3;
  profile.kinematics.elbow_max_rad = 1e3;
  return profile;
}

double total_work_J(const ArmModel::Work& work) {
  return work.motor_positive_J + work.motor_negative_J + work.hand_J + work.friction_J +
         work.stops_J + work.gravity_J;
}

// Angles near the middle of every arm's workspace.
Vector3d centre_rad(const profiles::DeviceProfile& profile) {
  return profile.name == "phantom_desktop" ? Vector3d(0.0, 0.1406, -0.1406)
                                           : Vector3d(0.0, 0.3438, 0.6636);
}

TEST(ArmModel, FreeArmKeepsItsKineticEnergy) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop"}) {
    auto profile = without_stops(frictionless(name));
    profile.gravity.balanced = true;
    ArmModel arm(profile, std::nullopt, centre_rad(profile));
    arm.set_joint_speed({1.5, -0.8, 1.2});
    const double initial_J = arm.kinetic_energy_J();
    ASSERT_GT(initial_J, 1e-4);
    double worst = 0.0;
    for (int i = 0; i < 500; ++i) {
      arm.advance(1e-3, Vector3d::Zero(), Vector3d::Zero());
      worst = std::max(worst, std::abs(arm.kinetic_energy_J() / initial_J - 1.0));
    }
    // Second order: (rate * substep)^2 is (10 / s * 125 us)^2, some 1e-6, over 4000 substeps.
    EXPECT_LT(worst, 2e-4) << name;
    // And it did move, through Coriolis forces too: a straight line would need none.
    EXPECT_GT(std::abs(arm.joint_speed_rad_per_s()[0] - 1.5), 0.05) << name;
  }
}

TEST(ArmModel, AMassAtTheTipIsHeldByTheTransposedJacobianTimesItsWeight) {
  constexpr double kMass_kg = 0.3;
  auto profile = without_stops(frictionless("woodenhaptics_v2015"));
  profile.gravity.balanced = true;
  ArmModel arm(profile, std::nullopt, centre_rad(profile));
  arm.attach_tip_mass(kMass_kg);
  const double weight_N = kMass_kg * profile.gravity.acceleration_m_per_s2;
  const auto motion = arm.kinematics().motion(arm.joint_angle_rad(), Vector3d::Zero());
  arm.advance(0.2, weight_N * motion.jacobian_m_per_rad.row(2).transpose(), Vector3d::Zero());
  EXPECT_LT((arm.joint_angle_rad() - centre_rad(profile)).norm(), 1e-9);
  // Let fall, it moves as its weight alone makes it.
  const double height_m = arm.position_D().z();
  arm.advance(0.1, Vector3d::Zero(), Vector3d::Zero());
  const double fallen_m = height_m - arm.position_D().z();
  EXPECT_GT(fallen_m, 0.01);
  EXPECT_NEAR(arm.work().gravity_J, weight_N * fallen_m, 1e-4 * weight_N * fallen_m);
  EXPECT_NEAR(arm.kinetic_energy_J(), weight_N * fallen_m, 1e-3 * weight_N * fallen_m);
}

TEST(ArmModel, AHandThatLetsGoLeavesTheTipToItsWeight) {
  auto profile = without_stops(frictionless("woodenhaptics_v2015"));
  ArmModel held(profile, profile.firm_hand, centre_rad(profile));
  held.attach_tip_mass(0.1);
  held.advance(0.2, Vector3d::Zero(), held.hand_target_D());
  EXPECT_LT((held.joint_angle_rad() - centre_rad(profile)).norm(), 1e-9);
  held.release_hand();
  ArmModel never_held(profile, std::nullopt, centre_rad(profile));
  never_held.attach_tip_mass(0.1);
  for (ArmModel* arm : {&held, &never_held}) {
    arm->advance(0.1, Vector3d::Zero(), Vector3d::Zero());
  }
  EXPECT_LT((held.joint_angle_rad() - never_held.joint_angle_rad()).norm(), 1e-9);
  EXPECT_GT((held.joint_angle_rad() - centre_rad(profile)).norm(), 0.05);
}

TEST(ArmModel, AngularMomentumAboutTheVerticalIsConservedWithoutTorque) {
  auto profile = without_stops(frictionless("woodenhaptics_v2015"));
  profile.gravity.balanced = true;
  ArmModel arm(profile, std::nullopt, centre_rad(profile));
  arm.set_joint_speed({2.0, 0.5, 1.0});
  const auto momentum = [&] {
    const auto motion = arm.kinematics().motion(arm.joint_angle_rad(), Vector3d::Zero());
    const double lever_squared = motion.jacobian_m_per_rad.col(0).squaredNorm();
    return (profile.dynamics.tip_mass_kg * lever_squared + profile.dynamics.joint_inertia_kg_m2) *
           arm.joint_speed_rad_per_s()[0];
  };
  const double initial = momentum();
  arm.advance(0.4, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_NEAR(momentum() / initial, 1.0, 2e-4);  // integration error, as above
}

TEST(ArmModel, MotorWorkBecomesKineticEnergyWhenNothingElseActs) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop"}) {
    auto profile = without_stops(frictionless(name));
    profile.gravity.balanced = true;
    ArmModel arm(profile, std::nullopt, centre_rad(profile));
    for (int i = 0; i < 400; ++i) {
      const double phase = 2.0 * std::numbers::pi * 8.0 * i * 1e-3;
      arm.advance(1e-3, 0.02 * Vector3d(std::sin(phase), std::cos(phase), -std::sin(phase)),
                  Vector3d::Zero());
    }
    const auto& work = arm.work();
    EXPECT_GT(work.motor_positive_J, 0.0);
    EXPECT_LT(work.motor_negative_J, 0.0);
    EXPECT_EQ(work.friction_J, 0.0);
    const double delivered_J = work.motor_positive_J + work.motor_negative_J;
    EXPECT_NEAR(arm.kinetic_energy_J(), delivered_J, 2e-4 * work.motor_positive_J) << name;
  }
}

TEST(ArmModel, AllWorkTogetherIsTheKineticEnergy) {
  auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ArmModel arm(profile, profile.firm_hand, centre_rad(profile));
  const Vector3d home_D = arm.position_D();
  double largest_J = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const double phase = 2.0 * std::numbers::pi * 3.0 * i * 1e-3;
    arm.advance(1e-3, Vector3d(0.05, -0.1, 0.08),
                home_D + 0.02 * Vector3d(std::sin(phase), 0.0, 1.0 - std::cos(phase)));
    largest_J = std::max(largest_J, arm.kinetic_energy_J());
  }
  const auto& work = arm.work();
  EXPECT_LT(work.friction_J, 0.0);
  EXPECT_GT(largest_J, 1e-4);
  // Thousands of times less than what flowed through.
  EXPECT_NEAR(arm.kinetic_energy_J(), total_work_J(work),
              1e-3 * (std::abs(work.hand_J) + work.motor_positive_J - work.motor_negative_J));
}

TEST(ArmModel, GravityWorkIsTheLossOfPotentialEnergy) {
  auto profile = without_stops(frictionless("woodenhaptics_v2015"));
  ASSERT_FALSE(profile.gravity.balanced);
  ArmModel arm(profile, std::nullopt, centre_rad(profile));
  const auto potential_J = [&] {
    const auto theta =
        arm.kinematics().motion(arm.joint_angle_rad(), Vector3d::Zero()).linkage_angle_rad;
    const auto& gravity = profile.gravity;
    return gravity.acceleration_m_per_s2 *
           (gravity.link_b_mass_kg * gravity.link_b_center_m * std::cos(theta[1]) +
            gravity.link_c_mass_kg * (profile.kinematics.link_length_m[1] * std::cos(theta[1]) -
                                      gravity.link_c_center_m * std::cos(theta[2])));
  };
  const double start_J = potential_J();
  arm.advance(0.2, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_GT(start_J - potential_J(), 1e-3);  // it fell
  EXPECT_NEAR(arm.kinetic_energy_J(), start_J - potential_J(), 1e-3 * (start_J - potential_J()));
}

TEST(ArmModel, StaticDeflectionIsForceOverStiffnessOfTheHand) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "polhem_v1"}) {
    const auto profile = profiles::load_device_profile(name);
    for (const auto& hand : {profile.firm_hand, profile.light_hand}) {
      const Vector3d start =
          ArmKinematics(profile.kinematics)
              .joint_angle_rad({static_cast<double>(profile.calibration.pose_counts[0]),
                                static_cast<double>(profile.calibration.pose_counts[1]),
                                static_cast<double>(profile.calibration.pose_counts[2])});
      ArmModel arm(profile, hand, start);
      const Vector3d target_D = arm.position_D();
      const Vector3d torque_Nm(0.03, -0.05, 0.04);
      arm.advance(4.0, torque_Nm, target_D);  // many time constants of hand and friction
      const auto motion = arm.kinematics().motion(arm.joint_angle_rad(), Vector3d::Zero());
      const Vector3d force_D =
          motion.jacobian_m_per_rad.transpose().partialPivLu().solve(torque_Nm);
      const Vector3d expected_D = force_D / hand.stiffness_N_per_m;
      const Vector3d deflection_D = arm.position_D() - target_D;
      EXPECT_GT(expected_D.norm(), 2e-4) << name;
      EXPECT_LT((deflection_D - expected_D).norm(), 1e-3 * expected_D.norm() + 1e-6)
          << name << " " << deflection_D.transpose() << " for " << expected_D.transpose();
    }
  }
}

TEST(ArmModel, FrictionTakesAllEnergyAndNeverGivesAny) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop"}) {
    auto profile = without_stops(profiles::load_device_profile(name));
    profile.gravity.balanced = true;
    ArmModel arm(profile, std::nullopt, centre_rad(profile));
    arm.set_joint_speed({0.5, -0.4, 0.6});
    const double initial_J = arm.kinetic_energy_J();
    double last_J = initial_J;
    for (int i = 0; i < 3000; ++i) {
      arm.advance(1e-3, Vector3d::Zero(), Vector3d::Zero());
      EXPECT_LE(arm.kinetic_energy_J(), last_J + 1e-6 * initial_J) << name << " ms " << i;
      last_J = arm.kinetic_energy_J();
    }
    EXPECT_LT(last_J, 1e-6 * initial_J) << name;
    EXPECT_NEAR(arm.work().friction_J, -initial_J, 1e-3 * initial_J) << name;
  }
}

TEST(ArmModel, CoulombFrictionSlowsAJointAtItsKnownRate) {
  // Base joint alone, fast enough for tanh = 1: I q'' = -(coulomb + viscous q').
  auto profile = without_stops(profiles::load_device_profile("woodenhaptics_v2015"));
  profile.gravity.balanced = true;
  profile.dynamics.viscous_friction_Nm_s_per_rad = {};
  profile.dynamics.tip_mass_kg = 1e-9;  // only the joint inertia is left: no centrifugal coupling
  profile.dynamics.joint_inertia_kg_m2 = 0.01;
  ArmModel arm(profile, std::nullopt, centre_rad(profile));
  arm.set_joint_speed({2.0, 0.0, 0.0});
  arm.advance(0.5, Vector3d::Zero(), Vector3d::Zero());
  const double expected =
      2.0 - 0.5 * profile.dynamics.coulomb_friction_Nm[0] / profile.dynamics.joint_inertia_kg_m2;
  EXPECT_NEAR(arm.joint_speed_rad_per_s()[0], expected, 1e-5);
}

TEST(ArmModel, HardStopsHoldAgainstFullTorque) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop"}) {
    auto profile = profiles::load_device_profile(name);
    for (const double sign : {1.0, -1.0}) {
      ArmModel arm(profile, std::nullopt, centre_rad(profile));
      const double torque_Nm = 0.3;
      arm.advance(3.0, Vector3d(sign * torque_Nm, 0.0, 0.0), Vector3d::Zero());
      const double stop_rad =
          sign > 0 ? profile.kinematics.joint_max_rad[0] : profile.kinematics.joint_min_rad[0];
      // Equilibrium of a spring: torque / stiffness behind the stop; links b and c only fall.
      const double expected_rad =
          stop_rad + sign * torque_Nm / profile.dynamics.stop_stiffness_Nm_per_rad;
      EXPECT_NEAR(arm.joint_angle_rad()[0], expected_rad, 1e-3) << name << " sign " << sign;
    }
  }
}

TEST(ArmModel, ElbowStopsHoldAgainstStretching) {
  auto profile = profiles::load_device_profile("phantom_desktop");
  ArmModel arm(profile, std::nullopt, centre_rad(profile));
  // Raising the forearm with the upper arm lowered opens the elbow up to its own stop.
  arm.advance(3.0, Vector3d(0.0, -0.2, 0.2), Vector3d::Zero());
  const double elbow_rad = arm.kinematics().elbow_rad(arm.joint_angle_rad());
  const double give_rad = 0.4 / profile.dynamics.stop_stiffness_Nm_per_rad;
  EXPECT_LT(elbow_rad, profile.kinematics.elbow_max_rad + give_rad);
  EXPECT_LT(arm.joint_speed_rad_per_s().norm(), 1e-3);
}

TEST(ArmModel, StaysBoundedWhenALightHandSlamsTheArmIntoItsStops) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "polhem_v1", "vintage"}) {
    const auto profile = profiles::load_device_profile(name);
    ArmModel arm(profile, profile.light_hand, centre_rad(profile));
    const Vector3d home_D = arm.position_D();
    double worst = 0.0;
    for (int i = 0; i < 2000; ++i) {
      const double side = (i / 100) % 2 == 0 ? 0.5 : -0.5;
      arm.place_hand_target(home_D + Vector3d(side, -side, side));
      arm.advance(1e-3, 1.5 * Vector3d(side, side, -side), arm.hand_target_D());
      ASSERT_TRUE(arm.joint_angle_rad().allFinite()) << name;
      const auto& work = arm.work();
      const double exchanged_J =
          std::abs(work.hand_J) + work.motor_positive_J - work.motor_negative_J - work.friction_J;
      worst = std::max(worst, std::abs(arm.kinetic_energy_J() - total_work_J(work)) / exchanged_J);
    }
    // No energy out of nowhere, though half a metre of target and 0.75 N m whirl the arm through
    // its singular poses at up to 200 rad/s (some 0.03 rad a substep).
    EXPECT_LT(worst, 0.05) << name;
    arm.place_hand_target(home_D);
    arm.advance(4.0, Vector3d::Zero(), home_D);
    EXPECT_LT(arm.joint_speed_rad_per_s().norm(), 1e-2) << name;
  }
}

TEST(ArmModel, OddDurationsEndAtTheSameStateAsWholeMilliseconds) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ArmModel even(profile, profile.firm_hand, centre_rad(profile));
  ArmModel odd(profile, profile.firm_hand, centre_rad(profile));
  const Vector3d target_D = even.position_D();
  const Vector3d torque_Nm(0.05, 0.02, 0.05);
  for (int i = 0; i < 210; ++i) {
    even.advance(1e-3, torque_Nm, target_D);
  }
  for (int i = 0; i < 300; ++i) {
    odd.advance(0.7e-3, torque_Nm, target_D);
  }
  EXPECT_LT((even.joint_angle_rad() - odd.joint_angle_rad()).norm(), 1e-6);
  EXPECT_GT((even.position_D() - target_D).norm(), 1e-4);
}

}  // namespace
}  // namespace forcegrid::emulator
