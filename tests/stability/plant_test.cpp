// SPDX-License-Identifier: Apache-2.0
#include "stability/plant.h"

#include <gtest/gtest.h>

#include <cmath>

#include "profiles/device_profile.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kRounding_m = 1e-12;

Hand spring_hand(double mass_kg, double damping_N_s_per_m, double stiffness_N_per_m) {
  return {"test", {mass_kg, damping_N_s_per_m, stiffness_N_per_m, "test"}};
}

TEST(Plant, OscillatesAsADampedMassOnASpring) {
  // m = 0.1, b = 0.4, k = 250: delta = 2 /s, omega = sqrt(2500 - 4) rad/s.
  DeviceDynamics device{.mass_kg = 0.06, .damping_N_s_per_m = 0.0};
  Plant plant(device, spring_hand(0.04, 0.4, 250.0), Vector3d::Zero());
  plant.flick({0.02, 0.0, 0.0});  // 0.2 m/s
  for (int i = 0; i < 77; ++i) {
    plant.advance(1'300'000, Vector3d::Zero(), Vector3d::Zero());
  }
  const double time_s = 77 * 1.3e-3;
  const double omega = std::sqrt(2496.0);
  EXPECT_NEAR(plant.position_W().x(),
              0.2 / omega * std::exp(-2.0 * time_s) * std::sin(omega * time_s), kRounding_m);
  EXPECT_EQ(plant.position_W().y(), 0.0);
}

TEST(Plant, FollowsASteadyTargetWithTheLagOfTheDevicesOwnDamping) {
  // In the steady state k (r - x) = b_d r', whatever the hand's damping.
  DeviceDynamics device{.mass_kg = 0.06, .damping_N_s_per_m = 0.5};
  Plant plant(device, spring_hand(0.05, 5.0, 100.0), Vector3d::Zero());
  const double speed_m_per_s = 0.02;
  for (int i = 1; i <= 2000; ++i) {
    plant.advance(2'000'000, Vector3d::Zero(), Vector3d(0.0, speed_m_per_s * 0.002 * i, 0.0));
  }
  EXPECT_NEAR(plant.target_W().y() - plant.position_W().y(), 0.5 * speed_m_per_s / 100.0, 1e-9);
  EXPECT_NEAR(plant.velocity_W().y(), speed_m_per_s, 1e-9);
}

TEST(Plant, CoulombFrictionStopsASlidingMassWhereTheBooksSay) {
  // Distance to rest m v^2 / (2 f_c), friction only.
  DeviceDynamics device{.mass_kg = 0.06, .damping_N_s_per_m = 0.0, .coulomb_friction_N = 0.1};
  Plant plant(device, spring_hand(0.0, 0.0, 0.0), Vector3d::Zero());
  plant.flick(Vector3d(0.6, 0.0, 0.8) * 0.06 * 0.1);  // 0.1 m/s
  for (int i = 0; i < 100; ++i) {
    plant.advance(2'000'000, Vector3d::Zero(), Vector3d::Zero());
  }
  const double expected_m = 0.06 * 0.01 / 0.2;
  // The substep in which it stops is the only one that is not exact.
  EXPECT_NEAR(plant.position_W().norm(), expected_m, 0.1 * Plant::kFrictionStep_s);
  EXPECT_EQ(plant.velocity_W(), Vector3d::Zero());
  plant.advance(2'000'000, Vector3d(0.09, 0.0, 0.0), Vector3d::Zero());
  EXPECT_EQ(plant.velocity_W(), Vector3d::Zero()) << "pushed with less than the friction";
}

TEST(Plant, EncodersShowTheNearestStep) {
  Plant plant(DeviceDynamics{.position_step_m = 20e-6}, hand_of("firm"), Vector3d::Zero());
  const Vector3d seen_W = plant.measured_W({29e-6, 31e-6, -31e-6});
  EXPECT_NEAR(seen_W.x(), 20e-6, kRounding_m);
  EXPECT_NEAR(seen_W.y(), 40e-6, kRounding_m);
  EXPECT_NEAR(seen_W.z(), -40e-6, kRounding_m);
  Plant exact(DeviceDynamics{.position_step_m = 0.0}, hand_of("firm"), Vector3d::Zero());
  EXPECT_EQ(exact.measured_W({29e-6, 1.0, 2.0}), Vector3d(29e-6, 1.0, 2.0));
}

TEST(Plant, RefusesADeviceWithoutMass) {
  EXPECT_THROW(Plant(DeviceDynamics{.mass_kg = 0.0}, hand_of("none"), Vector3d::Zero()),
               std::invalid_argument);
}

TEST(Hands, LightAndFirmAreThoseOfTheEmulatedDevices) {
  for (const std::string& name : profiles::available_profiles()) {
    const profiles::DeviceProfile profile = profiles::load_device_profile(name);
    for (const auto& [hand, expected] : {std::pair{hand_of("light"), profile.light_hand},
                                         std::pair{hand_of("firm"), profile.firm_hand}}) {
      EXPECT_EQ(hand.impedance.mass_kg, expected.mass_kg) << name;
      EXPECT_EQ(hand.impedance.damping_N_s_per_m, expected.damping_N_s_per_m) << name;
      EXPECT_EQ(hand.impedance.stiffness_N_per_m, expected.stiffness_N_per_m) << name;
    }
  }
}

TEST(Hands, AnUnknownNameIsAnsweredWithTheKnownOnes) {
  try {
    hand_of("paw");
    FAIL() << "no exception";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "hand 'paw' is not known; use one of none, light, firm, arm");
  }
}

}  // namespace
}  // namespace forcegrid::stability
