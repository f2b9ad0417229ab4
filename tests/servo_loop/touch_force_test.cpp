// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/touch_force.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "servo_loop/first_touch.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kMaxForce_N = 5.0;
constexpr double kTolerance_N = 1e-12;  // rounding only
const Vector3d kPoint_W(0.1, -0.05, 0.02);

class PressedTouch : public ::testing::Test {
 protected:
  void begin(const Vector3d& once_W, const Vector3d& twice_W) {
    NearSurface surface;
    surface.has_press_forces = true;
    Vector3d::Map(surface.press_forces_W_N[0].data()) = once_W;
    Vector3d::Map(surface.press_forces_W_N[1].data()) = twice_W;
    force_.begin(surface, kPoint_W, normal_W_);
  }
  Vector3d at(double depth_m, const Vector3d& along_W = Vector3d::Zero()) const {
    return force_.at(kPoint_W - depth_m * normal_W_ + along_W);
  }

  Vector3d normal_W_ = Vector3d::UnitZ();
  TouchForce force_{kMaxForce_N};
};

TEST_F(PressedTouch, GrowsAsHertzSaysIfTheTwoForcesDo) {
  normal_W_ = Vector3d(1.0, -2.0, 3.0).normalized();
  begin(0.3 * normal_W_, 0.3 * std::pow(2.0, 1.5) * normal_W_);
  EXPECT_TRUE(force_.known());
  for (const double depth_m : {0.0001, 0.001, 0.0017, 0.002, 0.0035}) {
    const double expected_N = 0.3 * std::sqrt(std::pow(1e3 * depth_m, 3.0));
    EXPECT_LT((at(depth_m) - expected_N * normal_W_).norm(), kTolerance_N) << depth_m;
  }
}

TEST_F(PressedTouch, PushesFromTheSurfaceOnAndNeverPulls) {
  begin({0.0, 0.0, 1.0}, {0.0, 0.0, 2.0});
  EXPECT_EQ(at(0.0), Vector3d::Zero());
  EXPECT_EQ(at(-1e-4), Vector3d::Zero());
  EXPECT_EQ(at(-1e-2, {0.01, 0.0, 0.0}), Vector3d::Zero());
  begin({0.0, 0.0, -1.0}, {0.0, 0.0, 2.0});
  EXPECT_FALSE(force_.known()) << "nothing can be pressed against what pulls";
  EXPECT_EQ(at(0.001), Vector3d::Zero());
}

TEST_F(PressedTouch, GrowsNoFasterThanSquaredAndNoSlowerThanDepth) {
  begin({0.0, 0.0, 0.1}, {0.0, 0.0, 3.0});
  EXPECT_NEAR(at(0.002).z(), 0.4, kTolerance_N);
  begin({0.0, 0.0, 1.0}, {0.0, 0.0, 1.1});
  EXPECT_NEAR(at(0.002).z(), 2.0, kTolerance_N);
}

TEST_F(PressedTouch, FrictionIsTheShareOfThePushThatItWasWhenPressed) {
  begin({-0.1, 0.0, 1.0}, {-0.6, 0.0, 2.0});
  const Vector3d on_W(1e-4, 0.0, 0.0);  // where the tool goes: friction holds it back
  EXPECT_LT((at(0.0005, on_W) - Vector3d(-0.05, 0.0, 0.5)).norm(), kTolerance_N);
  EXPECT_LT((at(0.001, on_W) - Vector3d(-0.1, 0.0, 1.0)).norm(), kTolerance_N);
  EXPECT_LT((at(0.0015, on_W) - Vector3d(-0.3, 0.0, 1.5)).norm(), kTolerance_N);
  EXPECT_LT((at(0.002, on_W) - Vector3d(-0.6, 0.0, 2.0)).norm(), kTolerance_N);
  EXPECT_LT((at(0.003, on_W) - Vector3d(-0.9, 0.0, 3.0)).norm(), kTolerance_N);
}

TEST_F(PressedTouch, FrictionHelpsNoHandThatHasTurned) {
  begin({-0.3, 0.0, 1.0}, {-0.6, 0.0, 2.0});
  // Back: it would be pushed on. Across: as it was. Half back: what is across stays.
  EXPECT_LT((at(0.001, {-1e-4, 0.0, 0.0}) - Vector3d(0.0, 0.0, 1.0)).norm(), kTolerance_N);
  EXPECT_LT((at(0.001, {0.0, 1e-4, 0.0}) - Vector3d(-0.3, 0.0, 1.0)).norm(), kTolerance_N);
  EXPECT_LT((at(0.001, {-1e-4, 1e-4, 0.0}) - Vector3d(-0.15, -0.15, 1.0)).norm(), kTolerance_N);
}

TEST_F(PressedTouch, IsAtMostThePushAlongTheSurfaceAndTheLimitInAll) {
  begin({-4.0, 0.0, 1.0}, {-8.0, 0.0, 2.0});
  const Vector3d force_W = at(0.001, {1e-4, 0.0, 0.0});
  EXPECT_NEAR(force_W.z(), 1.0, kTolerance_N);
  EXPECT_NEAR(force_W.x(), -1.0, kTolerance_N);
  EXPECT_NEAR(at(0.1).norm(), kMaxForce_N, kTolerance_N);
}

TEST(TouchForce, WithoutStiffnessAndPressForcesIsNone) {
  TouchForce force(kMaxForce_N);
  EXPECT_FALSE(force.known());
  NearSurface surface;
  surface.has_stiffness = true;
  surface.stiffness_W_N_per_m[8] = -400.0;
  force.begin(surface, kPoint_W, Vector3d::UnitZ());
  EXPECT_NEAR(force.at(kPoint_W - Vector3d(0.0, 0.0, 0.001)).z(), 0.4, kTolerance_N);
  force.begin({}, kPoint_W, Vector3d::UnitZ());
  EXPECT_FALSE(force.known()) << "what was known of the touch before is forgotten";
  EXPECT_EQ(force.at(kPoint_W - Vector3d(0.0, 0.0, 0.001)), Vector3d::Zero());
}

}  // namespace
}  // namespace forcegrid::servo
