// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/contact_law.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kRounding_N = 1e-12;
constexpr std::uint64_t kSeed = 20260110;

const contact::ToolShape kSphere = contact::ToolShape::sphere(0.01);
const Vector3d kTool(0.0, 0.0, -0.01);  // the sphere's centre is at the origin
constexpr ContactLaw kSlippery{.friction = 0.0, .stick_m = 1e-4, .e_N_per_m = 500.0};
constexpr ContactLaw kRough{.friction = 0.5, .stick_m = 1e-4, .e_N_per_m = 500.0};

Reaction at(const Vector3d& point_W, const ContactPoint& point, const ContactLaw& law) {
  return react(kSphere, kTool, point_W, point, law);
}

TEST(ContactLaw, APointOutsideThatBearsNothingIsOpen) {
  const Reaction reaction = at({0.0, 0.0, -0.0101}, {}, kSlippery);
  EXPECT_EQ(reaction.state, Reaction::State::kOpen);
  EXPECT_EQ(reaction.force_W, Vector3d::Zero());
  EXPECT_NEAR(reaction.gap_m, 1e-4, 1e-15);
}

TEST(ContactLaw, AKnownForceHoldsAPointOnTheSurfaceExactly) {
  ContactPoint point;
  point.normal_N = 0.2;
  const Reaction on = at({0.0, 0.0, -0.01}, point, kSlippery);
  EXPECT_TRUE(on.force_W.isApprox(Vector3d(0.0, 0.0, -0.2), kRounding_N));
  // Pulled off by more than N / e it is let go, never pulled back.
  EXPECT_EQ(at({0.0, 0.0, -0.010401}, point, kSlippery).force_W, Vector3d::Zero());
  EXPECT_LT(at({0.0, 0.0, -0.010399}, point, kSlippery).force_W.z(), 0.0);
}

TEST(ContactLaw, FrictionGrowsUntilThePointSlipsAndThenIsMuTimesTheNormalForce) {
  const ContactLaw rough = kRough;
  ContactPoint point;
  point.normal_N = 0.2;
  point.anchor_T = Vector3d(0.0, 0.0, -0.01) - kTool;
  const double bound_N = rough.friction * point.normal_N;
  // Moved by an angle of `way` / R over the sphere.
  const auto moved = [&](double way_m) {
    const double angle = way_m / 0.01;
    return at(0.01 * Vector3d(std::sin(angle), 0.0, -std::cos(angle)), point, rough);
  };
  const Reaction half = moved(0.5e-4);
  EXPECT_EQ(half.state, Reaction::State::kStick);
  EXPECT_NEAR((half.force_W - half.normal_N * half.normal_W).norm(), 0.5 * bound_N, 1e-4 * bound_N);
  const Reaction slipping = moved(3e-4);
  EXPECT_EQ(slipping.state, Reaction::State::kSlip);
  const Vector3d friction_W = slipping.force_W - slipping.normal_N * slipping.normal_W;
  EXPECT_NEAR(friction_W.norm(), bound_N, kRounding_N);
  EXPECT_LT(friction_W.x(), 0.0) << "against the way";
  EXPECT_NEAR(friction_W.dot(slipping.normal_W), 0.0, kRounding_N);
}

TEST(ContactLaw, AHeldPointIsPulledToItsAnchorFromEverySide) {
  ContactPoint point;
  point.held = true;
  point.anchor_T = Vector3d(0.02, 0.0, 0.0);
  point.held_W = Vector3d(0.0, 0.1, 0.0);
  const Reaction reaction = at(kTool + Vector3d(0.021, 0.0, 0.0), point, kRough);
  EXPECT_EQ(reaction.state, Reaction::State::kHeld);
  EXPECT_TRUE(reaction.force_W.isApprox(Vector3d(-0.5, 0.1, 0.0), 1e-9));
}

TEST(ContactLaw, ItsStiffnessIsMinusTheForcesDerivativeAtTheKnownNormalForce) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr double kStep_m = 1e-8;
  for (int trial = 0; trial < 200; ++trial) {
    const ContactLaw& law = trial % 2 == 0 ? kRough : kSlippery;
    ContactPoint point;
    point.normal_N = 0.2;
    point.anchor_T = Vector3d(3e-4 * uniform(random), 3e-4 * uniform(random), -0.01) - kTool;
    // Inside, so that the known force is the one that determines friction.
    const Vector3d here =
        0.00995 * Vector3d(0.1 * uniform(random), 0.1 * uniform(random), -1.0).normalized();
    const Reaction reaction = at(here, point, law);
    Eigen::Matrix3d derivative;
    for (int c = 0; c < 3; ++c) {
      const Vector3d step = kStep_m * Vector3d::Unit(c);
      derivative.col(c) =
          (at(here + step, point, law).force_W - at(here - step, point, law).force_W) /
          (2.0 * kStep_m);
    }
    // stiffness_W takes the turning normal at the known force, 0.2 N, not at the present 0.225 N.
    const double turning_N_per_m = (reaction.normal_N - point.normal_N) / 0.00995;
    const double friction_turns_N_per_m = law.friction * point.normal_N / 0.00995;
    EXPECT_LT((reaction.stiffness_W + derivative).norm(),
              2.0 * turning_N_per_m + 4.0 * friction_turns_N_per_m + 0.1)
        << "trial " << trial;
  }
}

}  // namespace
}  // namespace forcegrid::simulator
