// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/solver_bench.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "rt/thread_time.h"
#include "simulator/bench/bullet_peer.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/reference/solver_motion.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/newton_cg_baseline.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

Scene little_scene(double cubic) {
  Scene scene;
  scene.name = "little";
  LatticeBlockOptions options;
  options.vertex_count = {8, 8, 7};
  options.law.cubic_coefficient = cubic;
  scene.mesh = make_lattice_block(options);
  return scene;
}

// A slow circle of 5 mm that begins where the tool took hold.
std::vector<Vector3d> circle_W(double rate_Hz, double duration_s) {
  std::vector<Vector3d> places_W;
  for (int tick = 0; tick < static_cast<int>(duration_s * rate_Hz); ++tick) {
    const double phase = 6.0 * tick / rate_Hz;
    places_W.emplace_back(0.005 * std::sin(phase), 0.0, 0.005 * (1.0 - std::cos(phase)));
  }
  return places_W;
}

// The same plane, on another way and faster.
std::vector<Vector3d> rosette_W() {
  std::vector<Vector3d> places_W;
  for (int tick = 1; tick < 200; ++tick) {
    places_W.emplace_back(0.006 * std::sin(0.31 * tick), 0.0005 * std::sin(0.2 * tick),
                          0.006 * (1.0 - std::cos(0.17 * tick)));
  }
  return places_W;
}

TEST(NewtonCgBaseline, FindsTheSameForceAsTheSolverWithSensitivities) {
  for (const double cubic : {0.0, 5.0}) {
    const Scene scene = little_scene(cubic);
    ElasticObject<double> reference(scene.mesh, {.relative_tolerance = 1e-8});
    NewtonCgBaseline newton(scene.mesh, {.relative_tolerance = 1e-4});
    ASSERT_EQ(reference.grab(Vector3d::Zero(), 0.012), newton.grab(Vector3d::Zero(), 0.012));
    for (const Vector3d& at_W : circle_W(30.0, 1.0)) {
      const Vector3d expected_W = reference.move_to(at_W).force_W;
      const NewtonCgBaseline::Answer answer = newton.move_to(at_W);
      EXPECT_TRUE(answer.converged) << at_W.transpose();
      // The raw sum over the patch is off by some ten times the residual.
      EXPECT_LT((answer.force_W - expected_W).norm(), 3e-3 * std::max(expected_W.norm(), 0.05));
    }
  }
}

TEST(NewtonCgBaseline, FindsTheSameForceOfElementsOfSpringsBesideThemAndOnHomeSprings) {
  for (const ElementModel model : kElementModels) {
    SpringMesh mesh = element_block({5, 5, 4}, 0.01, soft(model, 0.4));
    mesh.springs.push_back({.a = 40, .b = 120, .stiffness_N_per_m = 20.0});
    mesh.home_stiffness_N_per_m.assign(mesh.rest_position_W.size(), 0.5);
    ElasticObject<double> reference(mesh, {.relative_tolerance = 1e-8});
    NewtonCgBaseline newton(mesh, {.relative_tolerance = 1e-4});
    ASSERT_EQ(reference.grab(Vector3d::Zero(), 0.012), newton.grab(Vector3d::Zero(), 0.012));
    for (const Vector3d& at_W : circle_W(30.0, 1.0)) {
      const Vector3d expected_W = reference.move_to(at_W).force_W;
      const NewtonCgBaseline::Answer answer = newton.move_to(at_W);
      EXPECT_TRUE(answer.converged) << at_W.transpose();
      EXPECT_LT((answer.force_W - expected_W).norm(), 3e-3 * std::max(expected_W.norm(), 0.05));
    }
  }
}

TEST(NewtonCgBaseline, RefusesAToleranceThatNothingCanMeet) {
  EXPECT_THROW(NewtonCgBaseline(little_scene(0.0).mesh, {.relative_tolerance = 0.0}), Error);
}

TEST(BulletPeer, ComesNearTheSpringsEquilibriumButNotToIt) {
  const Scene scene = little_scene(0.0);
  const Vector3d step_W(0.0, 0.0, 0.010);
  ElasticObject<double> reference(scene.mesh, {.relative_tolerance = 1e-8});
  reference.grab(Vector3d::Zero(), scene.patch_radius_m);
  const Vector3d converged_W = reference.move_to(step_W).force_W;
  const std::vector<StepPoint> points = bullet_peer(0.1, 400).run(scene, step_W, converged_W);
  ASSERT_GT(points.size(), 4U);
  EXPECT_GT(points.front().error_percent, 20.0) << "it began at the answer";
  EXPECT_LT(points.back().error_percent, 20.0);
  EXPECT_GT(points.back().time_ms, points.front().time_ms);
}

TEST(BulletPeer, RefusesFiniteElementsAlsoBesideSprings) {
  Scene scene = little_scene(0.0);
  scene.name = "mixed";
  append(element_block({2, 2, 2}, 0.01, soft(ElementModel::kNeoHookean)), scene.mesh);
  try {
    bullet_peer(0.1, 2).run(scene, {0.0, 0.0, 0.01}, {0.0, 0.0, 1.0});
    FAIL() << "it takes a scene whose elements it leaves out";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::StartsWith("scene mixed, peer bullet: "));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("finite elements"));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("block_linear"));
  }
}

TEST(SolverBench, MeasuresAllSolversAgainstTheConvergedForce) {
  SolverBenchOptions options;
  options.passes = 1;
  options.at_30_Hz_W = circle_W(30.0, 2.0);
  options.at_500_Hz_W = circle_W(500.0, 0.7);
  options.peers.push_back(
      {"nobody", [](const Scene&, const Vector3d&, const Vector3d&) {
         return std::vector<StepPoint>{{1.0, 0.5, 0.9}, {2.0, 0.4, 3.0}, {3.0, 5e-3, 0.5}};
       }});
  options.training_W = rosette_W();
  options.learning_W = circle_W(100.0, 3.0);
  const SolverBenchResult result = bench_solvers(little_scene(5.0), options);
  for (const MotionRow& row : result.motion) {
    EXPECT_EQ(row.ticks, row.rate_Hz == 30.0 ? 45U : 100U);
    EXPECT_GT(row.mean_ms, 0.0);
    EXPECT_GE(row.max_ms, row.mean_ms);
    EXPECT_GE(row.max_error_percent, row.error_percent);
    EXPECT_LT(row.error_percent, row.solver == "newton_cg" ? 15.0 : 0.5) << row.setting;
  }
  EXPECT_EQ(std::count_if(result.motion.begin(), result.motion.end(),
                          [](const MotionRow& row) { return row.solver == "reduced"; }),
            2);
  ASSERT_EQ(result.reduced.size(), 1U);
  EXPECT_GT(result.reduced[0].states, 5U);
  EXPECT_LT(result.reduced[0].springs, result.springs / 5);
  EXPECT_GT(result.reduced[0].state_error_percent, 1e-4) << "they can't be the same numbers";
  EXPECT_LT(result.reduced[0].state_error_percent, 5.0);
  EXPECT_GE(result.reduced[0].max_state_error_percent, result.reduced[0].state_error_percent);
  EXPECT_EQ(to_json(result)["reduced"][0]["modes"], result.reduced[0].modes);
  ASSERT_EQ(result.learning.size(), 1U);
  const LearningRow& learning = result.learning[0];
  EXPECT_EQ(learning.answers, 300U);
  EXPECT_GT(learning.by_model_percent, 30.0) << "the circle is gone round three times";
  EXPECT_LT(learning.by_model_percent, 100.0) << "at first nothing is known";
  EXPECT_LT(learning.model_error_percent, 0.3);
  EXPECT_GE(learning.max_error_percent, learning.model_error_percent);
  EXPECT_GE(learning.model_p99_ms, learning.model_median_ms);
  EXPECT_GE(learning.trainings, 1U);
  EXPECT_GT(learning.checks, learning.failed_checks);
  EXPECT_EQ(to_json(result)["learning"][0]["trainings"], learning.trainings);
  ASSERT_EQ(result.step.size(), 3U);
  EXPECT_LT(result.step[0].least_error_percent, 1e-3);
  EXPECT_LE(result.step[0].to_error_1_ms, result.step[0].to_error_01_ms);
  // Of the points above: in passing at 1 ms, for good at 3 ms, never to 0.1 %.
  EXPECT_EQ(result.step[2].first_error_1_ms, 1.0);
  EXPECT_EQ(result.step[2].to_error_1_ms, 3.0);
  EXPECT_EQ(result.step[2].to_residual_1e2_ms, 3.0);
  EXPECT_TRUE(std::isinf(result.step[2].to_error_01_ms));
  EXPECT_TRUE(to_json(result)["step"][2]["to_error_0.1_percent_ms"].is_null());
}

TEST(SolverBench, LeavesTheStepOutWhereThePeersLackTheScenesForces) {
  Scene scene = little_scene(5.0);
  tighten(scene.mesh, 0.2, 1.0);
  SolverBenchOptions options;
  options.passes = 1;
  options.at_30_Hz_W = circle_W(30.0, 1.0);
  options.at_500_Hz_W = circle_W(500.0, 0.6);
  const SolverBenchResult result = bench_solvers(scene, options);
  EXPECT_TRUE(result.step.empty());
  ASSERT_EQ(result.remarks.size(), 1U);
  EXPECT_THAT(result.remarks.front(), ::testing::HasSubstr("home springs or dead loads"));
}

TEST(SolverBench, OfFiniteElementsMeasuresTheSolversThatKnowThem) {
  Scene scene;
  scene.name = "elements";
  scene.mesh = element_block({4, 4, 3}, 0.01, {ElementModel::kNeoHookean, 5000.0, 0.4, 1000.0});
  SolverBenchOptions options;
  options.passes = 1;
  options.at_30_Hz_W = circle_W(30.0, 2.0);
  options.at_500_Hz_W = circle_W(500.0, 0.7);
  options.training_W = rosette_W();
  options.learning_W = circle_W(100.0, 3.0);
  const SolverBenchResult result = bench_solvers(scene, options);
  EXPECT_EQ(result.tetrahedra, 6U * 4U * 4U * 3U);
  EXPECT_GE(result.motion.size(), 10U);
  for (const MotionRow& row : result.motion) {
    EXPECT_NE(row.solver, "reduced");
    EXPECT_LT(row.error_percent, row.solver == "newton_cg" ? 5.0 : 1.0)
        << row.solver << ", " << row.setting;
  }
  EXPECT_EQ(std::count_if(result.motion.begin(), result.motion.end(),
                          [](const MotionRow& row) { return row.solver == "newton_cg"; }),
            10);  // at two rates
  EXPECT_TRUE(result.reduced.empty() && result.learning.empty() && result.step.empty());
  EXPECT_EQ(result.ratios.size(), result.motion.size() - 10U);
  ASSERT_EQ(result.remarks.size(), 1U);
  EXPECT_THAT(result.remarks.front(), ::testing::HasSubstr("finite elements"));
}

TEST(SolverMotion, OfSeveralPassesTheShortestTimeOfEachTickCounts) {
  const Scene scene = little_scene(0.0);
  const SolverMotion motion(scene, circle_W(100.0, 0.3), 100.0, 0.1);
  int made = 0;
  std::string order;
  // Busy for so many milliseconds per tick: 3, then 1, then 6.
  const auto busy = [&](char name) {
    order += name;
    const double busy_s = std::array{3e-3, 1e-3, 6e-3}.at(static_cast<std::size_t>(made++ / 2));
    return SolverSubject{std::string(1, name), std::to_string(made), [busy_s](const Vector3d&) {
                           const double end_s = rt::thread_time_s() + busy_s;
                           while (rt::thread_time_s() < end_s) {
                           }
                           return SolverSubject::Answer{};
                         }};
  };
  const std::vector<MotionRow> rows =
      motion.measure({[&] { return busy('a'); }, [&] { return busy('b'); }}, 3);
  EXPECT_EQ(order, "ababab") << "in turn, so that other work meets all of them";
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[1].solver, "b");
  EXPECT_EQ(rows[1].setting, "2") << "the first pass's";
  for (const MotionRow& row : rows) {
    EXPECT_EQ(row.ticks, 20U);
    EXPECT_GE(row.mean_ms, 1.0);
    // Processor time, and the shortest of three: other work doesn't count.
    EXPECT_LT(row.median_ms, 3.0);
  }
}

TEST(SolverBench, RefusesAMotionWithoutATickToCount) {
  SolverBenchOptions options;
  options.passes = 1;
  options.at_30_Hz_W = circle_W(30.0, 0.4);
  options.at_500_Hz_W = circle_W(500.0, 0.7);
  EXPECT_THROW(bench_solvers(little_scene(5.0), options), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
