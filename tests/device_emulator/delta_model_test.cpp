// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/delta_model.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <string>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;

profiles::DeviceProfile falcon() { return profiles::load_device_profile("falcon"); }

profiles::DeviceProfile frictionless() {
  profiles::DeviceProfile profile = falcon();
  profile.dynamics.coulomb_friction_Nm = {};
  profile.dynamics.viscous_friction_Nm_s_per_rad = {};
  return profile;
}

double work_J(const DeltaModel::Work& work) {
  return work.motor_positive_J + work.motor_negative_J + work.hand_J + work.friction_J +
         work.stops_J;
}

TEST(DeltaModel, FreeMotionKeepsItsEnergy) {
  DeltaModel model(frictionless(), std::nullopt, Vector3d::Zero());
  // 20 mm in 50 ms, curved by the legs' inertia.
  model.set_velocity({0.2, -0.25, 0.25});
  const double energy_J = model.kinetic_energy_J();
  model.advance(0.05, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_GT(model.position_D().norm(), 0.015);
  EXPECT_NEAR(model.kinetic_energy_J(), energy_J, 1e-7 * energy_J);
}

TEST(DeltaModel, KineticEnergyIsTheSumOfAllWork) {
  // A hand that shakes the knob against motors, friction and both kinds of stops.
  constexpr unsigned kSeed = 5;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  const auto profile = falcon();
  DeltaModel model(profile, profile.firm_hand, Vector3d::Zero());
  double most_J = 0.0;
  double exchanged_J = 0.0;
  for (int i = 0; i < 200; ++i) {
    const Vector3d torque_Nm = 0.2 * Vector3d(along(random), along(random), along(random));
    const Vector3d target_D = 0.07 * Vector3d(along(random), along(random), along(random));
    const double before_J = work_J(model.work());
    model.advance(0.02, torque_Nm, target_D);
    exchanged_J += std::abs(work_J(model.work()) - before_J);
    most_J = std::max(most_J, model.kinetic_energy_J());
    EXPECT_NEAR(model.kinetic_energy_J(), work_J(model.work()), 2e-3 * model.work().hand_J);
  }
  EXPECT_GT(most_J, 0.02) << "it has moved";
  EXPECT_GT(exchanged_J, most_J);
  EXPECT_LT(model.work().friction_J, 0.0);
  EXPECT_LT(model.work().stops_J, 0.0);
  EXPECT_LE(model.work().motor_negative_J, 0.0);
  EXPECT_GT(model.work().motor_positive_J, 0.0);
}

TEST(DeltaModel, MotorWorkIsTorqueTimesTheAngleTurned) {
  constexpr unsigned kSeed = 6;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  for (int i = 0; i < 20; ++i) {
    const Vector3d start_D(0.02 * along(random), 0.03 * along(random), 0.03 * along(random));
    DeltaModel model(frictionless(), std::nullopt, start_D);
    const Vector3d torque_Nm = 0.1 * Vector3d(along(random), along(random), along(random));
    const Vector3d before_rad = model.joint_angle_rad();
    model.advance(0.02, torque_Nm, start_D);
    const double turned_J = torque_Nm.dot(model.joint_angle_rad() - before_rad);
    EXPECT_NEAR(model.work().motor_positive_J + model.work().motor_negative_J, turned_J, 1e-12);
    // Nothing else is there to take it: it is all in the motion, to the integrator's accuracy.
    EXPECT_NEAR(model.kinetic_energy_J(), turned_J, 1e-3 * turned_J);
    EXPECT_GT(turned_J, 0.0);
  }
}

TEST(DeltaModel, MotorsHoldTheKnobAgainstTheHandsSpring) {
  auto profile = frictionless();
  DeltaModel model(profile, profile.firm_hand, Vector3d(0.0, 0.0, 0.01));
  const Vector3d force_D(1.0, -2.0, 1.5);
  Vector3d torque_Nm;
  for (int i = 0; i < 2000; ++i) {
    // tau = (R^-1)^T F at the place where the knob is.
    const auto pose = model.mechanism().pose(model.position_D());
    torque_Nm = pose->rate_rad_per_m.transpose().partialPivLu().solve(force_D);
    model.advance(1e-3, torque_Nm, Vector3d(0.0, 0.0, 0.01));
  }
  const Vector3d expected_D =
      Vector3d(0.0, 0.0, 0.01) + force_D / profile.firm_hand.stiffness_N_per_m;
  EXPECT_LT((model.position_D() - expected_D).norm(), 1e-7);
}

TEST(DeltaModel, AMassAtTheKnobWeighsUntilAHandBearsIt) {
  constexpr double kMass_kg = 0.2;
  const double weight_N = kMass_kg * profiles::kStandardGravity_m_per_s2;
  auto profile = falcon();
  profile.dynamics.coulomb_friction_Nm = {};
  profile.dynamics.viscous_friction_Nm_s_per_rad = {};
  DeltaModel model(profile, profile.firm_hand, Vector3d::Zero());
  model.attach_tip_mass(kMass_kg);
  model.advance(0.1, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_LT(model.position_D().norm(), 1e-9);
  model.release_hand();
  model.advance(0.05, Vector3d::Zero(), Vector3d::Zero());
  const double fallen_m = -model.position_D().z();
  EXPECT_GT(fallen_m, 0.001);
  EXPECT_NEAR(model.work().gravity_J, weight_N * fallen_m, 1e-9);
  EXPECT_NEAR(model.kinetic_energy_J(), weight_N * fallen_m, 1e-3 * weight_N * fallen_m);
}

TEST(DeltaModel, FrictionBringsTheKnobToRestAndHoldsIt) {
  const auto profile = falcon();
  DeltaModel model(profile, std::nullopt, Vector3d::Zero());
  model.set_velocity({0.1, 0.1, 0.0});
  model.advance(1.0, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_LT(model.velocity_D_m_per_s().norm(), 1e-3);
  const Vector3d rest_D = model.position_D();
  // Less than the Coulomb friction moves it only by the creep of its smooth start.
  model.advance(0.2, Vector3d::Constant(0.3 * profile.dynamics.coulomb_friction_Nm[0]),
                Vector3d::Zero());
  EXPECT_LT((model.position_D() - rest_D).norm(), 2e-4);
}

TEST(DeltaModel, StopsHoldTheStrongestMotorsOnEveryWay) {
  const auto profile = falcon();
  constexpr unsigned kSeed = 8;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> along(-1.0, 1.0);
  for (int i = 0; i < 60; ++i) {
    DeltaModel model(profile, std::nullopt, Vector3d::Zero());
    const Vector3d torque_Nm =
        0.4095 * Vector3d(along(random), along(random), along(random)).cwiseSign();
    model.advance(0.5, torque_Nm, Vector3d::Zero());
    const Vector3d position_B = model.mechanism().to_base(model.position_D());
    EXPECT_GT(position_B.z(), profile.delta.knob_min_z_m - 0.004);
    EXPECT_LT(position_B.z(), profile.delta.knob_max_z_m + 0.004);
    EXPECT_LT(position_B.head<2>().norm(), profile.delta.knob_max_radius_m + 0.004);
    EXPECT_GT(model.joint_angle_rad().minCoeff(), profile.delta.joint_min_rad - 0.1);
    EXPECT_LT(model.joint_angle_rad().maxCoeff(), profile.delta.joint_max_rad + 0.1);
    EXPECT_EQ(model.blocked_substeps(), 0U) << torque_Nm.transpose();
  }
}

TEST(DeltaModel, KnobThatIsForcedBeyondItsLegsStandsStillAndIsCounted) {
  // Without friction, which would hold stretched legs for ever, and without stops.
  auto profile = frictionless();
  profile.delta.knob_max_z_m = 1.0;
  profile.delta.joint_max_rad = 6.0;
  DeltaModel model(profile, profile.firm_hand, Vector3d(0.0, 0.0, 0.0));
  model.advance(1.0, Vector3d::Zero(), Vector3d(0.5, 0.0, 0.0));
  EXPECT_GT(model.blocked_substeps(), 0U);
  EXPECT_TRUE(model.position_D().allFinite());
  EXPECT_LT(model.mechanism().to_base(model.position_D()).z(), 0.185);
  model.place_hand_target(Vector3d::Zero());
  model.advance(4.0, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_LT(model.position_D().norm(), 2e-3) << "and comes back when it is let";
}

TEST(DeltaModel, StartBeyondTheLegsIsAnError) {
  EXPECT_THROW(DeltaModel(falcon(), std::nullopt, Vector3d(0.2, 0.0, 0.0)), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::emulator
