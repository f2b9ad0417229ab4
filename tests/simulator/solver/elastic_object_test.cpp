// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/elastic_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "reference_springs.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kPatchRadius_m = 0.012;

// A fixed vertex, a free one and one for the tool, on the z axis 0.1 m apart.
SpringMesh two_springs_in_series(double k1_N_per_m, double k2_N_per_m, double cubic) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, -0.2}, {0, 0, -0.1}, {0, 0, 0}};
  mesh.fixed = {1, 0, 0};
  mesh.springs = {{0, 1, k1_N_per_m}, {1, 2, k2_N_per_m}};
  mesh.laws = {{.cubic_coefficient = cubic}};
  return mesh;
}

SpringMesh little_block(double cubic = 5.0) {
  LatticeBlockOptions options;
  options.vertex_count = {6, 7, 5};
  options.size_m = {0.05, 0.06, 0.04};
  options.law.cubic_coefficient = cubic;
  return make_lattice_block(options);
}

SolverOptions tight(double relative_tolerance = 1e-9) {
  SolverOptions options;
  options.relative_tolerance = relative_tolerance;
  options.max_iterations = 4000;
  return options;
}

Eigen::Vector3d patch_sum(const std::vector<Vector3d>& forces,
                          const std::vector<std::int32_t>& patch) {
  Vector3d sum = Vector3d::Zero();
  for (const std::int32_t i : patch) {
    sum += forces[static_cast<std::size_t>(i)];
  }
  return sum;
}

// |r| over the vertices that neither the tool nor the ground holds.
double free_residual_N(const SpringMesh& mesh, const std::vector<Vector3d>& forces,
                       const std::vector<std::int32_t>& patch) {
  double squared = 0.0;
  for (std::size_t i = 0; i < forces.size(); ++i) {
    if (mesh.fixed[i] == 0 &&
        std::find(patch.begin(), patch.end(), static_cast<std::int32_t>(i)) == patch.end()) {
      squared += forces[i].squaredNorm();
    }
  }
  return std::sqrt(squared);
}

TEST(ElasticObject, TwoLinearSpringsInSeriesGiveTheTextbookForce) {
  const double k1 = 40.0;
  const double k2 = 10.0;
  ElasticObject<double> object(two_springs_in_series(k1, k2, 0.0), tight());
  ASSERT_EQ(object.grab(Vector3d::Zero(), 0.01), 1);
  const double d_m = 0.03;
  const Equilibrium pulled = object.move_to({0, 0, d_m});
  EXPECT_TRUE(pulled.converged);
  EXPECT_NEAR(pulled.force_W.z(), -k1 * k2 / (k1 + k2) * d_m, 1e-8);
  EXPECT_NEAR(pulled.force_W.x(), 0.0, 1e-12);
  EXPECT_NEAR(pulled.stiffness_W(2, 2), -k1 * k2 / (k1 + k2), 1e-4);  // S is single precision
  EXPECT_NEAR(object.positions_W()[1].z(), -0.1 + d_m * k2 / (k1 + k2), 1e-9);
  EXPECT_NEAR(object.sensitivity(1)(2, 2), k2 / (k1 + k2), 1e-5);
  // A stretched spring resists sideways with its tension over its length: two in series, both at
  // tension f, lengths l1 and l2, swing as a string of length l1 + l2.
  const double f = k1 * k2 / (k1 + k2) * d_m;
  EXPECT_NEAR(pulled.stiffness_W(0, 0), -f / (0.2 + d_m), 1e-4);
}

TEST(ElasticObject, TwoCubicSpringsInSeriesShareTheForceOfTheScalarEquation) {
  const double k1 = 40.0;
  const double k2 = 10.0;
  const double l0 = 0.1;
  const double d_m = 0.04;
  const auto tension = [l0](double k, double stretch_m) {
    const double e = stretch_m / l0;
    return k * l0 * (e + 5.0 * e * e * e);
  };
  double low = 0.0;
  double high = d_m;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (tension(k1, middle) < tension(k2, d_m - middle) ? low : high) = middle;
  }
  ElasticObject<double> object(two_springs_in_series(k1, k2, 5.0), tight());
  object.grab(Vector3d::Zero(), 0.01);
  const Equilibrium pulled = object.move_to({0, 0, d_m});
  EXPECT_TRUE(pulled.converged);
  EXPECT_NEAR(pulled.force_W.z(), -tension(k1, low), 1e-8);
}

TEST(ElasticObject, PullingTheTopUpGivesAForceDownAndShearingOneBack) {
  ElasticObject<float> object(little_block());
  ASSERT_GT(object.grab(Vector3d::Zero(), kPatchRadius_m), 0);
  const Vector3d at_rest = object.move_to(Vector3d::Zero()).force_W;
  EXPECT_LT(at_rest.norm(), 1e-5);
  EXPECT_LT(object.move_to({0, 0, 0.01}).force_W.z(), -0.05);
  EXPECT_GT(object.move_to({0, 0, -0.003}).force_W.z(), 0.05);
  EXPECT_LT(object.move_to({0.01, 0, 0}).force_W.x(), -0.05);
  EXPECT_GT(object.move_to({0, -0.01, 0}).force_W.y(), 0.05);
}

class ElasticObjectLaw : public ::testing::TestWithParam<double> {};

TEST_P(ElasticObjectLaw, ForceIsMinusTheEnergysSlope) {
  const SpringMesh mesh = little_block(GetParam());
  ElasticObject<double> object(mesh, tight());
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d at(0.004, -0.003, 0.008);
  const Equilibrium here = object.move_to(at);
  ASSERT_TRUE(here.converged) << here.relative_residual;
  constexpr double kStep_m = 1e-4;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = kStep_m * Vector3d::Unit(axis);
    ASSERT_TRUE(object.move_to(at + step).converged);
    const double above_J = testing::energy_J(mesh, object.positions_W());
    ASSERT_TRUE(object.move_to(at - step).converged);
    const double below_J = testing::energy_J(mesh, object.positions_W());
    // Central differences of step h leave h^2 F''/6, about 1e-8 m^2 * 1e4 N/m^2.
    EXPECT_NEAR(here.force_W[axis], -(above_J - below_J) / (2.0 * kStep_m), 1e-4);
  }
}

TEST_P(ElasticObjectLaw, StiffnessIsTheForcesSlopeAndSymmetric) {
  ElasticObject<double> object(little_block(GetParam()), tight());
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d at(-0.003, 0.005, 0.007);
  object.move_to(at + Vector3d(1e-5, 0, 0));
  // The smaller tolerance of S matters here: J's error is its square.
  const Equilibrium here = object.move_to(at);
  Matrix3d slope;
  constexpr double kStep_m = 1e-4;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = kStep_m * Vector3d::Unit(axis);
    const Vector3d above = object.move_to(at + step).force_W;
    const Vector3d below = object.move_to(at - step).force_W;
    slope.col(axis) = (above - below) / (2.0 * kStep_m);
  }
  const double scale = slope.norm();
  EXPECT_LT((here.stiffness_W - slope).norm(), 3e-3 * scale) << here.stiffness_W << "\nagainst\n"
                                                             << slope;
  EXPECT_LT((here.stiffness_W - here.stiffness_W.transpose()).norm(), 1e-5 * scale);
  EXPECT_LT(here.stiffness_W(2, 2), 0.0);
}

INSTANTIATE_TEST_SUITE_P(Laws, ElasticObjectLaw, ::testing::Values(0.0, 5.0));

template <typename Real>
class ElasticObjectPrecision : public ::testing::Test {};
using Precisions = ::testing::Types<float, double>;
TYPED_TEST_SUITE(ElasticObjectPrecision, Precisions);

TYPED_TEST(ElasticObjectPrecision, EveryClaimOfAnAnswerCanBeRecomputedFromThePositions) {
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<TypeParam> object(mesh);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const std::vector<std::int32_t> patch = object.patch();
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < 20; ++i) {
    const Vector3d at(0.008 * uniform(random), 0.008 * uniform(random),
                      0.008 + 0.008 * uniform(random));
    const Equilibrium answer = object.move_to(at);
    EXPECT_TRUE(answer.converged) << i;
    EXPECT_TRUE(answer.reached);
    EXPECT_LE(answer.relative_residual, 1e-3);
    const auto forces = testing::forces_W(mesh, object.positions_W());
    const double residual_N = free_residual_N(mesh, forces, patch);
    const double floor_N = object.options().force_floor_N;
    // Single precision: 1e-6 N on each of the vertices.
    EXPECT_NEAR(answer.relative_residual * std::max(answer.force_W.norm(), floor_N), residual_N,
                1e-3 * residual_N + 1e-5);
    EXPECT_LT((answer.raw_force_W - patch_sum(forces, patch)).norm(), 2e-5);
    EXPECT_NEAR(answer.force_gap_N, (answer.force_W - answer.raw_force_W).norm(), 1e-12);
    Vector3d corrected = patch_sum(forces, patch);
    for (std::size_t v = 0; v < forces.size(); ++v) {
      if (mesh.fixed[v] == 0 &&
          std::find(patch.begin(), patch.end(), static_cast<std::int32_t>(v)) == patch.end()) {
        corrected += object.sensitivity(v).transpose() * forces[v];
      }
    }
    EXPECT_LT((answer.force_W - corrected).norm(), 2e-5);
    for (const std::int32_t p : patch) {
      const auto v = static_cast<std::size_t>(p);
      EXPECT_LT((object.positions_W()[v] - mesh.rest_position_W[v] - at).norm(), 1e-8);
      EXPECT_TRUE(object.sensitivity(v).isIdentity(0.0));
    }
  }
}

TYPED_TEST(ElasticObjectPrecision, PullsComeBackToTheSameForces) {
  ElasticObject<TypeParam> object(make_scene("small").mesh);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  std::vector<Vector3d> out;
  const auto path = [](int i) { return Vector3d(0.0002 * i, -0.0001 * i, 0.0004 * i); };
  for (int i = 1; i <= 40; ++i) {
    out.push_back(object.move_to(path(i)).force_W);
  }
  double largest_N = 0.0;
  for (int i = 39; i >= 1; --i) {
    const Equilibrium back = object.move_to(path(i));
    const Vector3d& there = out[static_cast<std::size_t>(i - 1)];
    largest_N = std::max(largest_N, there.norm());
    // Both to 1e-3 of the residual: forces to well below that.
    EXPECT_LT((back.force_W - there).norm(), 1e-3 * std::max(there.norm(), 0.05)) << i;
  }
  EXPECT_GT(largest_N, 1.0);
}

TEST(ElasticObject, CorrectedForceIsFarMoreAccurateThanThePatchSum) {
  const SpringMesh mesh = make_scene("small").mesh;
  SolverOptions loose;
  loose.relative_tolerance = 1e-2;
  ElasticObject<float> object(mesh, loose);
  ElasticObject<double> exact(mesh, tight());
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  exact.grab(Vector3d::Zero(), kPatchRadius_m);
  double raw = 0.0;
  double corrected = 0.0;
  double squared_N2 = 0.0;
  for (int i = 1; i <= 60; ++i) {
    const double t = 0.1 * i;
    const Vector3d at(0.006 * std::sin(t), 0.005 * std::sin(1.3 * t), 0.006 * (1 - std::cos(t)));
    const Equilibrium answer = object.move_to(at);
    const Equilibrium reference = exact.move_to(at);
    ASSERT_TRUE(reference.converged);
    raw += (answer.raw_force_W - reference.force_W).squaredNorm();
    corrected += (answer.force_W - reference.force_W).squaredNorm();
    squared_N2 += reference.force_W.squaredNorm();
  }
  EXPECT_LT(std::sqrt(corrected / squared_N2), 2e-3);
  EXPECT_LT(corrected, raw / 25.0);  // a fifth of the error, squared
}

TEST(ElasticObject, SinglePrecisionAgreesWithDoubleToATenthOfAPercent) {
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<float> single(mesh);
  ElasticObject<double> exact(mesh, tight());
  single.grab(Vector3d::Zero(), kPatchRadius_m);
  exact.grab(Vector3d::Zero(), kPatchRadius_m);
  double error = 0.0;
  double squared_N2 = 0.0;
  for (int i = 1; i <= 60; ++i) {
    const double t = 0.15 * i;
    const Vector3d at(0.008 * std::sin(t), 0.008 * std::sin(0.7 * t),
                      0.009 * (1 - std::cos(1.2 * t)));
    const Equilibrium answer = single.move_to(at);
    EXPECT_TRUE(answer.converged);
    const Vector3d reference = exact.move_to(at).force_W;
    error += (answer.force_W - reference).squaredNorm();
    squared_N2 += reference.squaredNorm();
  }
  EXPECT_LT(std::sqrt(error / squared_N2), 1e-3);
}

TEST(ElasticObject, DoubleReachesTheToleranceOfTheOffLineForce) {
  ElasticObject<double> object(make_scene("small").mesh, tight(1e-10));
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Equilibrium answer = object.move_to({0.004, 0.002, 0.012});
  EXPECT_TRUE(answer.converged);
  EXPECT_LE(answer.relative_residual, 1e-10);
  EXPECT_LT(answer.force_gap_N, 1e-8);
}

TEST(ElasticObject, TheDefaultBlockHasTheStiffnessOfTheSheet) {
  // Lattice of 10,164 vertices with k = 10 N/m: 116 N/m normal to the surface for another draw of
  // the random part (measured elsewhere, with another code).
  ElasticObject<float> object(make_scene("block").mesh);
  EXPECT_GT(object.grab(Vector3d::Zero(), kPatchRadius_m), 20);
  const Equilibrium answer = object.move_to({0, 0, 1e-4});
  EXPECT_TRUE(answer.converged);
  EXPECT_NEAR(-answer.stiffness_W(2, 2), 116.0, 12.0);
  EXPECT_NEAR(answer.force_W.z(), answer.stiffness_W(2, 2) * 1e-4, 1e-4);
}

TEST(ElasticObject, ALongMoveIsMadeInStepsAndEndsWhereShortOnesDo) {
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<float> jumper(mesh);
  ElasticObject<float> walker(mesh);
  jumper.grab(Vector3d::Zero(), kPatchRadius_m);
  walker.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d target(0.009, -0.006, 0.018);
  const Equilibrium jumped = jumper.move_to(target);
  EXPECT_EQ(jumped.steps, static_cast<int>(std::ceil(target.norm() / 2e-3)));
  EXPECT_TRUE(jumped.converged);
  EXPECT_TRUE(jumped.reached);
  Equilibrium walked;
  for (int i = 1; i <= 50; ++i) {
    walked = walker.move_to(target * i / 50.0);
    EXPECT_EQ(walked.steps, 1);
  }
  EXPECT_LT((jumped.force_W - walked.force_W).norm(), 2e-3 * walked.force_W.norm());
}

TEST(ElasticObject, AMoveOfSomeStepsIsMadeInOneWhereItIsPredictedWell) {
  const SpringMesh mesh = make_scene("small").mesh;
  SolverOptions divided;
  divided.long_step_residual = 0.0;
  SolverOptions strict;
  strict.long_step_residual = 1e-9;  // tried, and given up
  ElasticObject<float> object(mesh);
  ElasticObject<float> walker(mesh, divided);
  ElasticObject<float> doubter(mesh, strict);
  ElasticObject<double> exact(mesh, tight());
  for (ElasticObject<float>* each : {&object, &walker, &doubter}) {
    each->grab(Vector3d::Zero(), kPatchRadius_m);
    each->move_to({0.0, 0.0, 0.0015});
  }
  exact.grab(Vector3d::Zero(), kPatchRadius_m);
  for (int i = 1; i <= 4; ++i) {
    const Vector3d at(0.001 * i, 0.0, 0.0015 + 0.0035 * i);
    const Vector3d expected_W = exact.move_to(at).force_W;
    const auto is_right = [&expected_W](const Equilibrium& answer) {
      return answer.converged && answer.reached &&
             (answer.force_W - expected_W).norm() < 2e-3 * expected_W.norm();
    };
    const Equilibrium in_one = object.move_to(at);
    EXPECT_EQ(in_one.steps, 1) << i;
    EXPECT_TRUE(is_right(in_one)) << i;
    const Equilibrium in_two = walker.move_to(at);
    EXPECT_EQ(in_two.steps, 2) << i;
    EXPECT_TRUE(is_right(in_two)) << i;
    const Equilibrium tried = doubter.move_to(at);
    EXPECT_EQ(tried.steps, 2) << i;
    EXPECT_EQ(tried.halvings, 0) << i;
    EXPECT_GE(tried.evaluations, 3) << "the one that was given up, too";
    EXPECT_TRUE(is_right(tried)) << i;
  }
}

TEST(ElasticObject, RefusesAResidualOfLongStepsBelowZero) {
  SolverOptions options;
  options.long_step_residual = -1.0;
  EXPECT_THROW(ElasticObject<float>(little_block(), options), Error);
}

TEST(ElasticObject, AMoveTooLongForOneAnswerSaysHowFarItGot) {
  SolverOptions options;
  options.max_steps = 4;
  ElasticObject<float> object(make_scene("small").mesh, options);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d target(0, 0, 0.02);
  const Equilibrium first = object.move_to(target);
  EXPECT_FALSE(first.reached);
  EXPECT_TRUE(first.converged);
  EXPECT_NEAR(first.displacement_W.z(), 0.008, 1e-9);
  object.move_to(target);
  const Equilibrium last = object.move_to(target);
  EXPECT_TRUE(last.reached);
  EXPECT_EQ(last.displacement_W, target);
}

TEST(ElasticObject, DeepPushesEndWithinTheirBoundsWhateverTheObjectDoes) {
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<float> object(mesh);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const std::vector<std::int32_t> patch = object.patch();
  int branch_changes = 0;
  for (int i = 1; i <= 40; ++i) {
    const Equilibrium answer = object.move_to({0.0002 * i, 0, -0.001 * i});
    EXPECT_TRUE(answer.force_W.allFinite()) << i;
    EXPECT_LE(answer.iterations, 24 * 40 + 3 * object.options().max_iterations) << i;
    branch_changes += answer.left_branch ? 1 : 0;
    if (answer.converged) {
      const auto forces = testing::forces_W(mesh, object.positions_W());
      EXPECT_LE(free_residual_N(mesh, forces, patch), 1.1e-3 * answer.force_W.norm() + 1e-4) << i;
    }
  }
  // 40 mm into a block of 12.5 mm spacing snaps through on the way.
  EXPECT_GE(branch_changes, 1);
  // And back out: the object must still answer.
  for (int i = 40; i >= -10; --i) {
    EXPECT_TRUE(object.move_to({0.0002 * i, 0, -0.001 * i}).force_W.allFinite());
  }
  EXPECT_TRUE(object.move_to({0, 0, 0.01}).converged);
}

TEST(ElasticObject, AfterASnapThroughItFindsTheOtherEquilibrium) {
  SolverOptions options = tight(1e-6);
  options.max_recovery_steps = 100;
  const SpringMesh mesh = make_scene("small").mesh;
  ElasticObject<double> object(mesh, options);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  int branch_changes = 0;
  int unconverged = 0;
  for (int i = 1; i <= 40; ++i) {
    const Equilibrium answer = object.move_to({0.0002 * i, 0, -0.001 * i});
    branch_changes += answer.left_branch ? 1 : 0;
    unconverged += answer.converged ? 0 : 1;
  }
  EXPECT_GE(branch_changes, 1);
  // Newton steps alone, without a descent in energy, leave nine of the forty unconverged.
  EXPECT_LE(unconverged, 2);
}

TEST(ElasticObject, APositionThatIsNotFiniteChangesNothing) {
  ElasticObject<float> object(make_scene("small").mesh);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Equilibrium before = object.move_to({0, 0, 0.01});
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const Equilibrium answer = object.move_to({0, bad, 0});
    EXPECT_FALSE(answer.converged);
    EXPECT_FALSE(answer.reached);
    EXPECT_EQ(answer.force_W, before.force_W);
    EXPECT_EQ(answer.displacement_W, before.displacement_W);
  }
  const Equilibrium after = object.move_to({0, 0, 0.01});
  EXPECT_TRUE(after.converged);
  EXPECT_LT((after.force_W - before.force_W).norm(), 1e-3 * before.force_W.norm());
}

TEST(ElasticObject, ReleasingItRestoresTheRestPose) {
  const SpringMesh mesh = little_block();
  ElasticObject<float> object(mesh);
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d first = object.move_to({0, 0.002, 0.01}).force_W;
  EXPECT_THROW(object.grab(Vector3d::Zero(), kPatchRadius_m), Error);
  object.release();
  EXPECT_FALSE(object.grabbed());
  EXPECT_EQ(object.move_to({0, 0, 0.01}).force_W, Vector3d::Zero());
  const auto positions = object.positions_W();
  for (std::size_t i = 0; i < positions.size(); ++i) {
    EXPECT_LT((positions[i] - mesh.rest_position_W[i]).norm(), 1e-8);
  }
  object.grab(Vector3d::Zero(), kPatchRadius_m);
  const Vector3d again = object.move_to({0, 0.002, 0.01}).force_W;
  EXPECT_LT((again - first).norm(), 1e-6);
}

TEST(ElasticObject, HoldsOnlyFreeVerticesWithinTheRadius) {
  const SpringMesh mesh = little_block();
  ElasticObject<float> object(mesh);
  EXPECT_EQ(object.grab({0, 0, 0.05}, kPatchRadius_m), 0);
  EXPECT_FALSE(object.grabbed());
  EXPECT_EQ(object.grab({0, 0, -0.05}, kPatchRadius_m), 0) << "the bottom is fixed";
  const Vector3d point(0.01, 0.0, 0.0);
  int near = 0;
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    near += (mesh.rest_position_W[i] - point).norm() <= kPatchRadius_m ? 1 : 0;
  }
  EXPECT_EQ(object.count_grabbable(point, kPatchRadius_m), near);
  EXPECT_EQ(object.grab(point, kPatchRadius_m), near);
  EXPECT_EQ(object.patch().size(), static_cast<std::size_t>(near));
}

TEST(ElasticObject, RefusesOptionsOutOfRangeByName) {
  SolverOptions options;
  options.relative_tolerance = 0.0;
  try {
    ElasticObject<float> object(little_block(), options);
    ADD_FAILURE() << "taken";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("relative_tolerance"));
  }
  options = {};
  options.max_steps = 0;
  EXPECT_THROW(ElasticObject<double>(little_block(), options), Error);
  ElasticObject<float> object(little_block());
  EXPECT_THROW(object.set_relative_tolerance(-1.0), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
