// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/rivals.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/rivals/coarse_mesh.h"
#include "simulator/rivals/condensation.h"
#include "simulator/rivals/greens_functions.h"
#include "simulator/rivals/penetration_depth.h"
#include "simulator/rivals/two_rates_method.h"
#include "simulator/rivals/unit_responses.h"
#include "simulator/solver/elastic_object.h"
#include "tests/simulator/rivals/little_blocks.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::block_with;
using ::testing::HasSubstr;
using testing::kGrip_m;
using testing::kTop_W;

constexpr std::uint64_t kSeed = 20261123;

SolverOptions exact() {
  SolverOptions options;
  options.relative_tolerance = 1e-8;
  options.force_floor_N = 1e-6;
  options.max_iterations = 4000;
  return options;
}

// The force of the object itself, in double precision.
Vector3d object_force_W(const SpringMesh& mesh, const Vector3d& point_W,
                        const Vector3d& displacement_W) {
  ElasticObject<double> object(mesh, exact());
  EXPECT_GT(object.grab(point_W, kGrip_m), 0);
  const Equilibrium answer = object.move_to(displacement_W);
  EXPECT_LT(answer.relative_residual, 1e-6);
  return answer.force_W;
}

Vector3d force_of(ForceMethod& method, const Vector3d& point_W, const Vector3d& displacement_W) {
  method.contact_made(1, point_W);
  method.observe(0.0, point_W + displacement_W);
  const ForceEstimate estimate = method.force(0.0, point_W + displacement_W);
  EXPECT_EQ(estimate.status, EstimateStatus::kOk) << method.name();
  return estimate.force_W;
}

// For a displacement so small that the object is linear: the even part of its force is left out.
Vector3d small_object_force_W(const SpringMesh& mesh, const Vector3d& point_W,
                              const Vector3d& small_W) {
  return 0.5 * (object_force_W(mesh, point_W, small_W) - object_force_W(mesh, point_W, -small_W));
}

TEST(LinearRivals, EqualTheObjectInSmallDisplacementsAtEveryContactWithinReach) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const SpringMesh mesh = block_with(0.3, 5.0, kSeed);
  const ContactReach reach{.patch_radius_m = kGrip_m, .reach_m = 0.025};
  GreensFunctionsMethod greens(make_greens_table(mesh, reach));
  CondensationMethod condensation(make_condensed_table(mesh, reach));
  for (int trial = 0; trial < 6; ++trial) {
    SCOPED_TRACE(trial);
    const Vector3d point_W =
        kTop_W + (trial == 0 ? Vector3d(Vector3d::Zero())
                             : Vector3d(0.017 * uniform(random), 0.017 * uniform(random), 0.0));
    const Vector3d small_W = 1e-5 * Vector3d(uniform(random), uniform(random), uniform(random));
    const Vector3d expected_W = small_object_force_W(mesh, point_W, small_W);
    const double size_N = expected_W.norm();
    ASSERT_GT(size_N, 1e-6);
    // 1e-5 m strains a spring of 20 mm by 5e-4, of which the square is left.
    EXPECT_LT((force_of(greens, point_W, small_W) - expected_W).norm(), 1e-4 * size_N);
    EXPECT_LT(
        (force_of(greens, point_W, small_W) - force_of(condensation, point_W, small_W)).norm(),
        1e-9 * size_N);
  }
}

TEST(LinearRivals, HaveTheStiffnessOfTheSolverAtRest) {
  const SpringMesh mesh = block_with(0.3, 5.0);
  SolverOptions options = exact();
  options.sensitivity_tolerance = 1e-6;
  ElasticObject<double> object(mesh, options);
  ASSERT_GT(object.grab(kTop_W, kGrip_m), 0);
  Matrix3d stiffness_W = object.move_to(Vector3d::Zero()).stiffness_W;
  const ContactReach reach{.patch_radius_m = kGrip_m};
  GreensFunctionsMethod greens(make_greens_table(mesh, reach));
  Matrix3d of_greens_W;
  for (int axis = 0; axis < 3; ++axis) {
    of_greens_W.col(axis) = force_of(greens, kTop_W, Vector3d::Unit(axis));
  }
  // The sensitivities are single precision.
  EXPECT_LT((of_greens_W - stiffness_W).norm(), 1e-4 * stiffness_W.norm());
}

TEST(PenetrationDepth, IsRightAlongTheNormalAndKnowsNothingElse) {
  const SpringMesh mesh = block_with(0.0, 0.0);
  PenetrationDepthMethod method(make_penetration_table(mesh, kGrip_m));
  const Vector3d along_W(0.0, 0.0, -1e-5);
  const Vector3d pushed_W = small_object_force_W(mesh, kTop_W, along_W);
  EXPECT_LT((force_of(method, kTop_W, along_W) - pushed_W).norm(), 1e-3 * pushed_W.norm());
  const Vector3d sideways_W(1e-5, 0.0, 0.0);
  EXPECT_GT(small_object_force_W(mesh, kTop_W, sideways_W).norm(), 0.3 * pushed_W.norm());
  EXPECT_LT(force_of(method, kTop_W, sideways_W).norm(), 1e-9 * pushed_W.norm());
  // On a side, the same stiffness along that side's normal, whatever the object does there.
  const Vector3d side_W = kTop_W + Vector3d(0.05, 0.0, -0.05);
  const Vector3d on_side_W = force_of(method, side_W, Vector3d(-1e-5, 0.0, 0.0));
  EXPECT_LT((on_side_W - Vector3d(pushed_W.norm(), 0.0, 0.0)).norm(), 1e-3 * pushed_W.norm());
}

TEST(UnitResponses, AreExactAtTheirOwnDisplacementsAndSumInBetween) {
  const SpringMesh mesh = block_with(0.3, 5.0);
  constexpr double kStep_m = 0.004;
  UnitResponseMethod method(make_unit_responses(
      mesh, {.patch_radius_m = kGrip_m, .places_W = {kTop_W}, .step_m = kStep_m}));
  Vector3d sum_W = Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const Vector3d step_W = sign * kStep_m * Vector3d::Unit(axis);
      const Vector3d expected_W = object_force_W(mesh, kTop_W, step_W);
      EXPECT_LT((force_of(method, kTop_W, step_W) - expected_W).norm(), 1e-5 * expected_W.norm());
      EXPECT_LT((force_of(method, kTop_W, 0.5 * step_W) - 0.5 * expected_W).norm(),
                1e-5 * expected_W.norm());
      sum_W += sign > 0.0 ? expected_W : Vector3d(Vector3d::Zero());
    }
  }
  const Vector3d oblique_W = force_of(method, kTop_W, Vector3d::Constant(kStep_m));
  EXPECT_LT((oblique_W - sum_W).norm(), 1e-5 * sum_W.norm());
  // The hardening object itself is not a sum.
  const Vector3d of_object_W = object_force_W(mesh, kTop_W, Vector3d::Constant(kStep_m));
  EXPECT_GT((oblique_W - of_object_W).norm(), 1e-3 * of_object_W.norm());
}

TEST(CoarseMesh, HasTheFineObjectsNormalStiffnessAtRestWithFewerVertices) {
  const Scene scene = make_scene("small", kTop_W);
  const SpringMesh coarse = make_coarser_mesh("small", kTop_W);
  EXPECT_EQ(coarse.rest_position_W.size(), 6U * 6U * 5U);
  const CoarseObject object = match_at_rest(scene.mesh, coarse, 0.012);
  EXPECT_NEAR(object.patch_radius_m, std::sqrt(2.0) * 0.010, 1e-9);  // the nearest are four
  CoarseMeshMethod method(object, false);
  ElasticObject<double> fine(scene.mesh, exact());
  ASSERT_GT(fine.grab(kTop_W, 0.012), 0);
  for (const double height_m : {2e-4, -2e-4}) {
    const Vector3d up_W(0.0, 0.0, height_m);
    const double expected_N = fine.move_to(up_W).force_W.z();
    method.contact_made(1, kTop_W);
    for (int cycle = 0; cycle < 30; ++cycle) {  // single precision, a few iterations a cycle
      method.observe(0.0, kTop_W + up_W);
    }
    EXPECT_NEAR(method.force(0.0, kTop_W + up_W).force_W.z(), expected_N,
                0.01 * std::abs(expected_N));
  }
  EXPECT_LT(method.memory_bytes(), ElasticObject<float>(scene.mesh).memory_bytes());
}

TEST(TwoRates, FollowsTheObject) {
  const SpringMesh mesh = make_scene("small", kTop_W).mesh;
  TwoRatesMethod method(mesh, {.most_vertices = 200});
  method.contact_made(1, kTop_W);
  method.work(1);
  const Vector3d end_W(0.003, -0.002, 0.006);
  for (int cycle = 1; cycle <= 300; ++cycle) {
    method.observe(0.002 * cycle, kTop_W + std::min(1.0, cycle / 200.0) * end_W);
    if (cycle % 16 == 0) {
      EXPECT_EQ(method.work(1), 0);
    }
  }
  ElasticObject<double> object(mesh, exact());
  ASSERT_GT(object.grab(kTop_W, 0.012), 0);
  const Vector3d expected_W = object.move_to(end_W).force_W;
  const ForceEstimate estimate = method.force(0.6, kTop_W + end_W);
  EXPECT_EQ(estimate.status, EstimateStatus::kOk);
  EXPECT_LT((estimate.force_W - expected_W).norm(), 5e-3 * expected_W.norm());
}

class EveryRival : public ::testing::TestWithParam<std::string> {
 public:
  static SpringMesh mesh() { return make_scene("small", kTop_W).mesh; }
  static RivalTables tables() {
    return RivalTables([] { return make_coarser_mesh("small", kTop_W); });
  }
};

TEST_P(EveryRival, KeepsTheContractOfAForceMethod) {
  RivalTables all = tables();
  const SpringMesh object = mesh();
  const MadeRival made = all.make(GetParam(), object, 0.012);
  ForceMethod& method = *made.method;
  EXPECT_EQ(method.name(), GetParam());
  EXPECT_TRUE(is_rival(GetParam()));
  EXPECT_FALSE(method.needs().requests || method.needs().stiffness);
  EXPECT_EQ(method.force(0.0, kTop_W).status, EstimateStatus::kUnknown);
  EXPECT_EQ(method.force(0.0, kTop_W).force_W, Vector3d::Zero());

  const Vector3d pulled_W = kTop_W + Vector3d(0.0, 0.0, 0.004);
  EXPECT_LT(force_of(method, kTop_W, pulled_W - kTop_W).z(), -0.1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(method.force(0.0, Vector3d(0.0, nan, 0.0)).status, EstimateStatus::kNotFinite);
  EXPECT_EQ(method.force(0.0, Vector3d(0.0, nan, 0.0)).force_W, Vector3d::Zero());
  Sample sample;
  sample.force_W = Vector3d(5.0, 5.0, 5.0);
  method.take_sample(sample);
  EXPECT_LT(method.force(0.0, pulled_W).force_W.x(), 1.0) << "it learnt from a sample";

  method.contact_lost();
  EXPECT_EQ(method.force(0.0, pulled_W).status, EstimateStatus::kOk);
  EXPECT_EQ(method.force(0.0, pulled_W).force_W, Vector3d::Zero());

  for (const Vector3d& nowhere_W :
       {Vector3d(kTop_W + Vector3d(0.5, 0.0, 0.5)), Vector3d(Vector3d::Constant(nan))}) {
    method.contact_made(3, nowhere_W);
    method.observe(0.0, nowhere_W);
    EXPECT_NE(method.force(0.0, kTop_W).status, EstimateStatus::kOk);
    EXPECT_EQ(method.force(0.0, kTop_W).force_W, Vector3d::Zero());
  }
}

TEST_P(EveryRival, CountsItsTablesAndMakesThemOnce) {
  RivalTables all = tables();
  const SpringMesh object = mesh();
  const MadeRival first = all.make(GetParam(), object, 0.012);
  const MadeRival second = all.make(GetParam(), object, 0.012);
  EXPECT_NE(first.method.get(), second.method.get());
  if (GetParam() == "two-rates") {
    EXPECT_TRUE(std::isnan(first.precompute_s));
  } else {
    EXPECT_GT(first.precompute_s, 0.0);
    EXPECT_EQ(first.precompute_s, second.precompute_s);
  }
  EXPECT_EQ(first.method->memory_bytes(), second.method->memory_bytes());
  // A tool within 10 mm of the top holds what is within 22 mm of it.
  ElasticObject<float> around(object);
  const auto nodes = static_cast<std::size_t>(around.count_grabbable(kTop_W, 0.022));
  const std::size_t least = GetParam() == "greens-functions" ? 72 * nodes * nodes
                            : GetParam() == "condensation"   ? 144 * nodes * nodes
                            : GetParam() == "two-rates"      ? 2 * around.memory_bytes() / 2
                            : GetParam() == "unit-responses" ? 6 * 3 * sizeof(double)
                                                             : 10'000;
  EXPECT_GT(first.method->memory_bytes(), least);
  EXPECT_LT(first.method->memory_bytes(), 20'000'000U);
}

INSTANTIATE_TEST_SUITE_P(Rivals, EveryRival,
                         ::testing::Values("penetration-depth", "coarse-mesh", "unit-responses",
                                           "greens-functions", "condensation", "two-rates"),
                         [](const auto& instance) {
                           std::string name = instance.param;
                           name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
                           return name;
                         });

std::string complaint_of(const std::string& name, const SpringMesh& mesh, double patch_radius_m) {
  try {
    RivalTables().make(name, mesh, patch_radius_m);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Rivals, SayWhyTheyCantBeMade) {
  const SpringMesh mesh = block_with(0.3, 0.0);
  EXPECT_THAT(complaint_of("green", mesh, kGrip_m), HasSubstr("greens-functions, condensation"));
  EXPECT_THAT(complaint_of("coarse-mesh", mesh, kGrip_m), HasSubstr("without a coarser mesh"));
  EXPECT_THAT(complaint_of("unit-responses", mesh, 0.001), HasSubstr("larger grip"));
  EXPECT_THAT(complaint_of("greens-functions", mesh, -1.0), HasSubstr("patch_radius_m is -1"));
  EXPECT_THAT(complaint_of("two-rates", mesh, 0.0), HasSubstr("two-rates: patch_radius_m"));
  SpringMesh bare = mesh;
  bare.triangles.clear();
  EXPECT_THAT(complaint_of("penetration-depth", bare, kGrip_m),
              HasSubstr("give the mesh triangles"));
  EXPECT_THROW(make_contact_nodes(mesh, {.patch_radius_m = kGrip_m, .reach_m = 0.0}), Error);
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(
      make_contact_nodes(mesh, {.patch_radius_m = kGrip_m, .reach_m = infinity}).vertex.size(),
      6U * 6U * 4U);
  const SpringMesh large = make_scene("block").mesh;
  EXPECT_THROW(make_contact_nodes(large, {.reach_m = infinity}), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
