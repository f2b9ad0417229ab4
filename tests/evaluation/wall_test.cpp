// SPDX-License-Identifier: Apache-2.0
#include "evaluation/objects/wall.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const Wall& wall_named(const std::string& name) {
  for (const NamedWalls& each : named_walls()) {
    if (each.name == name) {
      return each.walls.front();
    }
  }
  throw std::runtime_error("no walls " + name);
}

TEST(Wall, PushesBackByItsStiffnessAndOnlyBeyondItsSurface) {
  const Wall& flat = wall_named("wall_flat");
  EXPECT_EQ(flat.at({0.01, -0.02, 0.0139}).force_W, Vector3d::Zero());
  EXPECT_LT((flat.at({0.01, -0.02, 0.017}).force_W - Vector3d(0, 0, -3.0)).norm(), 1e-12);
  const Wall& stiffening = wall_named("wall_stiffening");
  EXPECT_NEAR(stiffening.at({0, 0, 0.018}).force_W.z(), -(500.0 * 0.004 + 1e5 * 16e-6), 1e-12);
  const Wall& tilted = wall_named("wall_tilted");
  const Vector3d push_N = tilted.at({0.0, 0.0, 0.018}).force_W;
  const double tilt_rad = 25.0 * std::numbers::pi / 180.0;
  EXPECT_NEAR(push_N.norm(), 1000.0 * 0.004 * std::cos(tilt_rad), 1e-12);
  EXPECT_NEAR(push_N.x() / push_N.z(), std::tan(tilt_rad), 1e-12);
}

TEST(Wall, CanBeABall) {
  const Wall& ball = wall_named("wall_curved");
  const Vector3d centre_m(0, 0, 0.034);
  for (const Vector3d& p : {Vector3d(0.01, 0.0, 0.018), Vector3d(-0.004, 0.008, 0.022)}) {
    const double deep_m = 0.020 - (p - centre_m).norm();
    ASSERT_GT(deep_m, 0.0);
    EXPECT_LT((ball.at(p).force_W - 1000.0 * deep_m * (p - centre_m).normalized()).norm(), 1e-12);
  }
  EXPECT_EQ(ball.at({0.015, 0.0, 0.015}).force_W, Vector3d::Zero()) << "beside it";
}

TEST(Wall, HasASoftEdgeIfAsked) {
  const Wall& soft = wall_named("wall_soft");
  EXPECT_NEAR(soft.at({0, 0, 0.014}).force_W.z(), -1000.0 * 0.5e-3 * std::log(2.0), 1e-12);
  EXPECT_NEAR(soft.at({0, 0, 0.024}).force_W.z(), -10.0, 1e-5);
  EXPECT_NEAR(soft.at({0, 0, 0.004}).force_W.z(), 0.0, 1e-5);
}

TEST(Wall, KnowsTheSlopeOfItsForce) {
  constexpr double kStep_m = 1e-7;
  for (const NamedWalls& each : named_walls()) {
    for (const Wall& wall : each.walls) {
      for (const Vector3d& p : {Vector3d(0.012, 0.003, 0.017), Vector3d(0.01, -0.006, 0.0225),
                                Vector3d(0.0, 0.0, 0.0141), Vector3d(0.0, 0.0, 0.005)}) {
        Matrix3d slope;
        for (int a = 0; a < 3; ++a) {
          const Vector3d step = kStep_m * Vector3d::Unit(a);
          slope.col(a) = (wall.at(p + step).force_W - wall.at(p - step).force_W) / (2.0 * kStep_m);
        }
        EXPECT_LT((wall.at(p).stiffness_W - slope).norm(), 1e-3) << each.name << " at " << p;
      }
    }
  }
}

TEST(WalledScenes, AreTheSameObjectWithWalls) {
  EXPECT_EQ(hard_scenes().size(),
            chart_scenes().size() * (named_walls().size() + named_object_effects().size()));
  const ChartScene& scene = chart_scene("small+wall_two");
  EXPECT_EQ(scene.object, "small");
  EXPECT_EQ(scene.extras.walls.size(), 2u);
  EXPECT_EQ(make_mesh(scene).springs.size(), make_mesh(chart_scene("small")).springs.size());
  EXPECT_TRUE(chart_scene("small").extras.walls.empty());
  EXPECT_THROW(chart_scene("small+wall_of_jelly"), ChartError);
}

TEST(WalledScenes, AreAlsoMadeOfScenesThatAreNotTheChartsOwn) {
  const ChartScene& plain = chart_scene("discrimination_soft");
  const ChartScene& walled = chart_scene("discrimination_soft+wall_two");
  EXPECT_EQ(plain.object, "discrimination_soft");
  EXPECT_EQ(walled.object, plain.object);
  EXPECT_TRUE(plain.extras.walls.empty());
  EXPECT_EQ(walled.extras.walls.size(), chart_scene("small+wall_two").extras.walls.size());
  EXPECT_EQ(chart_scene("stomach").patch_radius_m, 0.008);
  EXPECT_EQ(make_mesh(walled).top_W, first_contact_point_W());
  EXPECT_THROW(chart_scene("discrimination_soft+wall_of_jelly"), ChartError);
  EXPECT_THROW(chart_scene("discrimination_sofd"), ChartError);
}

// What the servo feels and what samples and answers say has to be one and the same object.
TEST(WalledScenes, AddTheWallToReferenceSamplesAndAnswers) {
  const TableLattice lattice;
  const ForceTable nothing(lattice, std::vector<Vector3d>(lattice.node_count(), Vector3d::Zero()));
  const std::vector<Wall> walls{wall_named("wall_flat")};
  const Trajectory regrab("regrab", 3);
  const NetworkCondition& condition = network_condition("requests120");
  const Trace trace = make_trace(regrab, nothing, condition, 500.0, 3, {walls, {}});
  std::size_t pushed = 0;
  const auto expected_N = [&](double time_s, const Vector3d& position_W) {
    return regrab.contact_at(time_s) < 0
               ? Vector3d(Vector3d::Zero())
               : walls.front().at(position_W - first_contact_point_W()).force_W;
  };
  for (const ServoInstant& instant : trace.servo) {
    EXPECT_LT((instant.force_W - expected_N(instant.time_s, instant.position_W)).norm(), 1e-12);
  }
  for (const DeliveredSample& delivered : trace.samples) {
    const Sample& sample = delivered.sample;
    EXPECT_LT((sample.force_W - expected_N(sample.time_s, sample.position_W)).norm(), 1e-12);
    pushed += sample.force_W != Vector3d::Zero() ? 1 : 0;
    EXPECT_NEAR(sample.stiffness_W(2, 2), sample.force_W != Vector3d::Zero() ? -1000.0 : 0.0, 1e-9);
  }
  EXPECT_GT(pushed, 5u);
  const JudgeOptions options = judge_options(regrab, nothing, condition, 500.0, 3, {walls, {}});
  const Vector3d deep_W = first_contact_point_W() + Vector3d(0.001, 0.002, 0.020);
  EXPECT_LT((options.answer(0.5, deep_W).force_W - Vector3d(0, 0, -6.0)).norm(), 1e-9);
}

}  // namespace
}  // namespace forcegrid::evaluation
