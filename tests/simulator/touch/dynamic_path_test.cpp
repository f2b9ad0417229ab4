// SPDX-License-Identifier: Apache-2.0
// A tool that moves to and fro on a Kelvin-Voigt link: the error of the simulator's answers at 30
// Hz against the closed form, with all of the servo's positions and with one per answer.

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <numbers>
#include <random>
#include <vector>

#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/reference/dynamic_reference.h"
#include "simulator/touch/dynamic_contact.h"
#include "tests/simulator/little_jelly.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 2e-3;
constexpr double kTick_s = 1.0 / 30.0;
constexpr double kCount_m = 23e-6;
constexpr double kTau_s = 0.02;
constexpr double kTouch_s = 0.2;  // the tool comes down until then
constexpr double kApproach_m_per_s = 0.05;
constexpr double kAmplitude_m = 4e-3;
constexpr double kOmega_rad_per_s = 2.0 * std::numbers::pi * 2.0;

// Eight vertices, the upper ones of which the tool holds; the lower are fixed. Nothing is free.
Scene link() {
  Scene scene;
  scene.name = "link";
  scene.patch_radius_m = 0.1;
  LatticeBlockOptions options;
  options.vertex_count = {2, 2, 2};
  options.size_m = {0.04, 0.04, 0.04};
  options.stiffness_N_per_m = 30.0;
  options.law = {};
  scene.mesh = make_lattice_block(options);
  give_dynamics(scene.mesh, {.mass_kg = 0.01, .retardation_time_s = kTau_s});
  return scene;
}

// F = -sum of k (l - l0 + tau l') u over the springs between the layers.
Vector3d link_force_W(const SpringMesh& mesh, const Vector3d& displacement_W,
                      const Vector3d& velocity_W) {
  Vector3d force_W = Vector3d::Zero();
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    if (mesh.fixed[a] == mesh.fixed[b]) {
      continue;
    }
    const std::size_t top = mesh.fixed[a] != 0 ? b : a;
    const std::size_t bottom = top == a ? b : a;
    const Vector3d at_rest = mesh.rest_position_W[top] - mesh.rest_position_W[bottom];
    const Vector3d now = at_rest + displacement_W;
    const Vector3d u = now.normalized();
    force_W -=
        spring.stiffness_N_per_m * (now.norm() - at_rest.norm() + kTau_s * u.dot(velocity_W)) * u;
  }
  return force_W;
}

// From above down to the origin, with a speed that does not jump there.
struct Place {
  Vector3d position_W;
  Vector3d velocity_W;
};
Place tool_at(double time_s) {
  const double since_s = time_s - kTouch_s;
  if (since_s < 0.0) {
    return {{0, 0, -kApproach_m_per_s * since_s}, {0, 0, -kApproach_m_per_s}};
  }
  const double phase = kOmega_rad_per_s * since_s;
  return {kAmplitude_m * Vector3d(0.5 * (1.0 - std::cos(phase)), 0.0, -std::sin(phase)),
          kAmplitude_m * kOmega_rad_per_s * Vector3d(0.5 * std::sin(phase), 0.0, -std::cos(phase))};
}
Vector3d counted_W(const Vector3d& position_W) {
  return kCount_m * (position_W / kCount_m).array().round().matrix();
}

struct Fate {
  bool all_positions = true;
  double loss = 0.0;
  double pause_from_s = 1e9;  ///< no positions for 60 ms
};

// [%] RMS of the answers' error from 0.5 s on, of the RMS of the force.
double error_percent(const Fate& fate) {
  constexpr unsigned kSeed = 3;
  const Scene scene = link();
  const auto contact = make_dynamic_contact(scene, {}, {});
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> chance(0.0, 1.0);
  double error = 0.0;
  double all = 0.0;
  int ticks = 0;
  for (int i = 0; i < 1500; ++i) {
    const double time_s = kCycle_s * i;
    const Place tool = tool_at(time_s);
    const bool pauses = time_s >= fate.pause_from_s && time_s < fate.pause_from_s + 0.06;
    if (pauses || chance(random) < fate.loss) {
      continue;
    }
    if (fate.all_positions) {
      contact->was_at(time_s, counted_W(tool.position_W));
    }
    if (time_s < ticks * kTick_s) {
      continue;
    }
    ticks = static_cast<int>(std::floor(time_s / kTick_s)) + 1;
    contact->tell_time(time_s);
    const auto answer = contact->step(counted_W(tool.position_W));
    if (time_s > 0.5) {
      EXPECT_TRUE(answer.in_contact);
      EXPECT_LT((answer.position_W - tool.position_W).norm(), 1.5 * kCount_m);
      const Vector3d reference_W =
          link_force_W(scene.mesh, tool.position_W - answer.point_W, tool.velocity_W);
      error += (answer.equilibrium.force_W - reference_W).squaredNorm();
      all += reference_W.squaredNorm();
    }
  }
  const double percent = 100.0 * std::sqrt(error / all);
  std::cout << "seed " << kSeed << ": " << percent << " %\n";
  return percent;
}

TEST(DynamicPath, ADamperFeelsTheSpeedAtTheAnswersMomentAndNotTheMeanOfThePeriodBefore) {
  // The mean is half a period late: tau w / sqrt(1 + (tau w)^2) of the force is the damper's, and
  // w 17 ms of that is wrong.
  const double damped = kTau_s * kOmega_rad_per_s;
  const double straight = 100.0 * damped / std::hypot(1.0, damped) * kOmega_rad_per_s * kTick_s / 2;
  EXPECT_NEAR(error_percent({.all_positions = false}), straight, 0.3 * straight);
  EXPECT_LT(error_percent({}), 0.1 * straight);
}

TEST(DynamicPath, LostPositionsAndAPauseCostLittle) {
  EXPECT_LT(error_percent({.loss = 0.3}), 1.2);
  // The way across the pause is straight, so that one answer is wrong.
  EXPECT_LT(error_percent({.pause_from_s = 1.5}), 2.0);
}

TEST(DynamicPath, TheToolTouchesWhereItsWayMeetsTheSurface) {
  const Scene scene = link();
  for (const bool all_positions : {true, false}) {
    const auto contact = make_dynamic_contact(scene, {}, {});
    ToolContact::Answer answer;
    double end_s = 0.0;
    for (int i = 0; !answer.in_contact && i < 1500; ++i) {
      const double time_s = kCycle_s * i;
      const Vector3d position_W = tool_at(time_s).position_W;
      if (all_positions) {
        contact->was_at(time_s, position_W);
      }
      if (i % 17 == 15) {
        contact->tell_time(time_s);
        answer = contact->step(position_W);
        end_s = time_s;
      }
    }
    ASSERT_TRUE(answer.in_contact);
    EXPECT_EQ(answer.epoch, 1U);
    EXPECT_NEAR(answer.point_W.z(), 0.0, 0.21e-3) << "the solver's steps are 0.1 mm apart";
    EXPECT_GT(answer.equilibrium.force_W.z(), 0.1) << "it has gone on since";
    EXPECT_LT((answer.position_W - tool_at(end_s).position_W).norm(), 0.05e-3);
  }
}

TEST(DynamicReferencePath, AToolThatTouchedBeforeTheFirstPositionHasComeAtTheSpeedThatItHas) {
  const Scene scene = testing::little_jelly();
  std::vector<Vector3d> positions_W;
  std::vector<double> times_s;
  for (int i = 0; i < 40; ++i) {
    positions_W.emplace_back(0, 0, 0.05 * kCycle_s * (i + 1));
    times_s.push_back(kCycle_s * i);
  }
  const ReferenceSolution whole = simulate_dynamic_reference(scene, positions_W, times_s, {});
  constexpr int kMissed = 12;
  positions_W.erase(positions_W.begin(), positions_W.begin() + kMissed);
  times_s.erase(times_s.begin(), times_s.begin() + kMissed);
  const ReferenceSolution part = simulate_dynamic_reference(scene, positions_W, times_s, {});
  for (std::size_t i = 0; i < part.forces_W.size(); ++i) {
    EXPECT_LT((part.forces_W[i] - whole.forces_W[i + kMissed]).norm(),
              0.03 * whole.forces_W[i + kMissed].norm())
        << i;
  }
}

}  // namespace
}  // namespace forcegrid::simulator
