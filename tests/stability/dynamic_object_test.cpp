// SPDX-License-Identifier: Apache-2.0
#include "stability/dynamic_object.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kStiffness_N_per_m = 200.0;
const Vector3d kContact_W(0.01, -0.02, 0.03);

// Goes to `displacement_W` and waits until nothing moves any more.
DynamicObject settled_at(const Vector3d& displacement_W, double damping_time_s) {
  DynamicObject object(kStiffness_N_per_m, kContact_W, damping_time_s);
  for (int i = 0; i <= 5000; ++i) {
    object.advance(2e-3 * i, kContact_W + displacement_W);
  }
  return object;
}

TEST(DynamicObject, IsASpringOfItsStiffnessAtRest) {
  for (const double damping_time_s : {0.005, 0.02, 0.1}) {
    const Vector3d at_W(0.0, 0.0, -0.004);
    const auto value = settled_at(at_W, damping_time_s).at(kContact_W + at_W);
    EXPECT_NEAR(value.force_W.z(), 0.004 * kStiffness_N_per_m, 1e-6);
    EXPECT_NEAR(value.force_W.x(), 0.0, 1e-9);  // the lattice is symmetric
    EXPECT_NEAR(value.stiffness_W(2, 2), -kStiffness_N_per_m, 1e-9);
  }
}

TEST(DynamicObject, ResistsASlowMotionByItsDampingTime) {
  // Far below its own frequencies M q'' is small, and F = -K (u + tau u'), all of it in one.
  constexpr double kAngular_rad_per_s = 2.0 * std::numbers::pi * 0.5;
  for (const double damping_time_s : {0.02, 0.1}) {
    DynamicObject object(kStiffness_N_per_m, kContact_W, damping_time_s);
    double in_phase_N = 0.0;
    double ahead_N = 0.0;
    constexpr int kCycles = 1000;  // 2 s, one turn
    for (int i = 0; i < 3 * kCycles; ++i) {
      const double angle_rad = kAngular_rad_per_s * 2e-3 * i;
      const Vector3d position_W = kContact_W + Vector3d(0.0, 0.0, 0.003 * std::sin(angle_rad));
      object.advance(2e-3 * i, position_W);
      if (i >= 2 * kCycles) {
        const double force_N = object.at(position_W).force_W.z();
        in_phase_N -= 2.0 / kCycles * force_N * std::sin(angle_rad);
        ahead_N -= 2.0 / kCycles * force_N * std::cos(angle_rad);
      }
    }
    EXPECT_NEAR(in_phase_N, 0.003 * kStiffness_N_per_m, 0.01 * 0.6);
    EXPECT_NEAR(ahead_N / in_phase_N, kAngular_rad_per_s * damping_time_s,
                0.05 * kAngular_rad_per_s * damping_time_s);
  }
}

TEST(DynamicObject, MovesByItself) {
  // A tool that stops at once: the masses go on, and the force is not what it is at rest.
  DynamicObject object(kStiffness_N_per_m, kContact_W, 0.005);
  const double period_s = object.slowest_period_s();
  EXPECT_GT(period_s, 0.01);
  EXPECT_LT(period_s, 0.5);
  const Vector3d at_W = kContact_W + Vector3d(0.0, 0.0, 0.004);
  object.advance(0.0, kContact_W);
  object.advance(0.002, at_W);
  double largest_N = 0.0;
  for (int i = 2; i < 30; ++i) {
    object.advance(2e-3 * i, at_W);
    largest_N =
        std::max(largest_N, std::abs(object.at(at_W).force_W.z() + 0.004 * kStiffness_N_per_m));
  }
  EXPECT_GT(largest_N, 0.1 * 0.8);
}

TEST(DynamicObject, NeverGivesMoreThanItGot) {
  for (const double damping_time_s : {0.005, 0.1}) {
    DynamicObject object(kStiffness_N_per_m, kContact_W, damping_time_s);
    double given_J = 0.0;
    double most_J = 0.0;
    Vector3d last_W = kContact_W;
    for (int i = 0; i < 3000; ++i) {
      const double t_s = 2e-3 * i;
      const Vector3d position_W =
          kContact_W +
          0.005 * Vector3d(std::sin(3.0 * t_s), std::sin(7.0 * t_s), std::sin(5.0 * t_s));
      const Vector3d before_W = object.at(last_W).force_W;
      object.advance(t_s, position_W);
      given_J += 0.5 * (before_W + object.at(position_W).force_W).dot(position_W - last_W);
      most_J = std::max(most_J, given_J);
      last_W = position_W;
    }
    EXPECT_LT(given_J, 0.0);
    EXPECT_LT(most_J, 1e-5) << damping_time_s;
  }
}

}  // namespace
}  // namespace forcegrid::stability
