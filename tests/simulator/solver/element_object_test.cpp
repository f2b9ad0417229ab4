// SPDX-License-Identifier: Apache-2.0
// The solvers of equilibria on finite elements.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/gravity.h"
#include "simulator/mesh/tangent_stiffness.h"
#include "simulator/mesh/tetrahedra.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/solver/direct_method.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/newton_cg_baseline.h"
#include "simulator/solver/pressed_springs.h"
#include "simulator/solver/two_rates_object.h"
#include "simulator/touch/solver_choice.h"
#include "tests/simulator/dense_newton.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kEdge_m = 0.01;
constexpr double kPatch_m = 0.012;

SolverOptions precise() {
  return {.relative_tolerance = 1e-9,
          .force_floor_N = 1e-3,
          .max_steps = 200,
          .max_iterations = 4000,
          .sensitivity_tolerance = 1e-4};
}

class ElementObjects : public testing::TestWithParam<ElementModel> {
 protected:
  SpringMesh mesh_ = element_block({4, 4, 3}, kEdge_m, soft(GetParam(), 0.4), 0.15);
};

TEST_P(ElementObjects, ForceAndPlacesAreThoseOfNewtonsMethodOnTheScalarReference) {
  const Vector3d displacement_W(0.004, -0.002, 0.006);
  DenseNewton newton(mesh_, Vector3d::Zero(), kPatch_m);
  const Vector3d expected_W = newton.force_at(displacement_W);
  ElasticObject<double> object(mesh_, precise());
  ASSERT_EQ(object.grab(Vector3d::Zero(), kPatch_m), static_cast<int>(newton.held.size()));
  const Equilibrium found = object.move_to(displacement_W);
  EXPECT_TRUE(found.converged && found.reached);
  EXPECT_FALSE(found.left_branch);
  EXPECT_LT((found.force_W - expected_W).norm(), 1e-8 * expected_W.norm());
  const std::vector<Vector3d> positions_W = object.positions_W();
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    EXPECT_LT((positions_W[i] - newton.position_W[i]).norm(), 1e-7 * displacement_W.norm());
  }
}

TEST_P(ElementObjects, StiffnessIsTheSlopeOfTheForce) {
  ElasticObject<double> object(mesh_, precise());
  object.grab(Vector3d::Zero(), kPatch_m);
  const Vector3d at_W(0.002, 0.001, -0.003);
  const Eigen::Matrix3d stiffness = object.move_to(at_W).stiffness_W;
  constexpr double kStep_m = 1e-5;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d by_W = kStep_m * Vector3d::Unit(axis);
    const Vector3d slope =
        (object.move_to(at_W + by_W).force_W - object.move_to(at_W - by_W).force_W) /
        (2.0 * kStep_m);
    EXPECT_LT((stiffness.col(axis) - slope).norm(), 1e-4 * stiffness.norm());
  }
}

TEST_P(ElementObjects, SinglePrecisionFollowsAMotionAt30Hz) {
  ElasticObject<float> object(mesh_, {});
  ElasticObject<double> reference(mesh_, precise());
  object.grab(Vector3d::Zero(), kPatch_m);
  reference.grab(Vector3d::Zero(), kPatch_m);
  double error_N2 = 0.0;
  double force_N2 = 0.0;
  for (int answer = 0; answer < 40; ++answer) {
    const double phase = 0.1 * answer;
    const Vector3d at_W(0.005 * std::sin(phase), 0.003 * std::sin(1.7 * phase),
                        0.004 * (std::cos(phase) - 1.0));
    const Equilibrium found = object.move_to(at_W);
    EXPECT_TRUE(found.converged) << "answer " << answer;
    const Vector3d force_W = reference.move_to(at_W).force_W;
    error_N2 += (found.force_W - force_W).squaredNorm();
    force_N2 += force_W.squaredNorm();
  }
  EXPECT_LT(std::sqrt(error_N2 / force_N2), 5e-4);
}

TEST_P(ElementObjects, AVertexOfAPatchTestHasNoForceInAnyHomogeneousState) {
  // Constant strain needs no force on inner vertices, whatever the mesh.
  std::mt19937 random(11);
  std::uniform_real_distribution<double> entry(-0.3, 0.3);
  Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 9; ++i) {
    f(i % 3, i / 3) += entry(random);
  }
  std::vector<Vector3d> position_W;
  for (const Vector3d& rest_W : mesh_.rest_position_W) {
    position_W.emplace_back(f * rest_W + Vector3d(0.1, 0.2, 0.3));
  }
  const std::vector<Vector3d> force_W = vertex_forces_W(mesh_, position_W);
  int inner = 0;
  for (std::size_t i = 0; i < force_W.size(); ++i) {
    const Vector3d& rest_W = mesh_.rest_position_W[i];
    const bool inside = std::abs(rest_W.x()) < 1.9 * kEdge_m &&
                        std::abs(rest_W.y()) < 1.9 * kEdge_m && rest_W.z() < -0.1 * kEdge_m &&
                        rest_W.z() > -2.9 * kEdge_m;
    if (inside) {
      ++inner;
      EXPECT_LT(force_W[i].norm(), 1e-12 * force_scale_N(mesh_));
    }
  }
  EXPECT_EQ(inner, 3 * 3 * 2);
}

TEST_P(ElementObjects, ARegionAndDirectAndTwoRatesFollowTheWhole) {
  const SpringMesh mesh = element_block({8, 8, 6}, kEdge_m, soft(GetParam(), 0.4), 0.15);
  ElasticObject<double> reference(mesh, precise());
  SolverOptions local;
  local.relative_tolerance = 1e-4;
  local.border_tolerance = 1e-3;
  ElasticObject<float> region(mesh, local);
  ElasticObject<float> direct(mesh, DirectOptions{}.solver);
  TwoRatesOptions two = two_rates_options(500.0, {});
  two.near.most_vertices = 200;
  two.own_thread = false;
  TwoRatesObject rates(mesh, two);
  reference.grab(Vector3d::Zero(), kPatch_m);
  region.grab(Vector3d::Zero(), kPatch_m);
  direct.grab(Vector3d::Zero(), kPatch_m);
  rates.grab(Vector3d::Zero(), kPatch_m);
  double force_N2 = 0.0;
  double region_N2 = 0.0;
  double direct_N2 = 0.0;
  double rates_N2 = 0.0;
  for (int cycle = 0; cycle < 120; ++cycle) {
    const double phase = 0.03 * cycle;
    const Vector3d at_W(0.005 * std::sin(phase), 0.0, 0.005 * (std::cos(phase) - 1.0));
    const Vector3d force_W = reference.move_to(at_W).force_W;
    force_N2 += force_W.squaredNorm();
    region_N2 += (region.move_to(at_W).force_W - force_W).squaredNorm();
    direct_N2 += (direct.move_to(at_W).force_W - force_W).squaredNorm();
    rates_N2 += (rates.move_to(at_W).force_W - force_W).squaredNorm();
    if (cycle % 4 == 3 && rates.whole_is_due()) {
      rates.solve_whole();
      rates.hand_over();
    }
  }
  EXPECT_LT(std::sqrt(region_N2 / force_N2), 5e-3);
  EXPECT_LT(std::sqrt(direct_N2 / force_N2), 2e-3);
  EXPECT_LT(std::sqrt(rates_N2 / force_N2), 1e-2);
}

TEST_P(ElementObjects, UnderItsWeightItRestsInEquilibriumAndItsForceIsZeroThere) {
  SpringMesh mesh = mesh_;
  const std::vector<double> masses_kg = element_masses_kg(mesh);
  double mass_kg = 0.0;
  for (const double each : masses_kg) {
    mass_kg += each;
  }
  EXPECT_NEAR(mass_kg, 1000.0 * 16 * 3 * 1e-6, 1e-12);  // density times 48 cells of 1 cm^3
  settle_under_gravity(mesh, mass_kg, 9.81);
  check(mesh);
  ElasticObject<double> object(mesh, precise());
  object.grab(mesh.rest_position_W[mesh.rest_position_W.size() / 2 + 30], 0.02);
  EXPECT_LT(object.move_to(Vector3d::Zero()).raw_force_W.norm() / (9.81 * mass_kg), 1.0);
  // The weight that the free vertices hang on the fixed ones.
  std::vector<Vector3d> force_W = vertex_forces_W(mesh, mesh.rest_position_W);
  double free_weight_N = 0.0;
  double ground_N = 0.0;
  for (std::size_t i = 0; i < force_W.size(); ++i) {
    if (mesh.fixed[i] != 0) {
      ground_N += force_W[i].z();
    } else {
      free_weight_N += 9.81 * masses_kg[i];
      EXPECT_LT(force_W[i].norm(), 1e-6 * force_scale_N(mesh));
    }
  }
  EXPECT_NEAR(-ground_N, free_weight_N, 1e-5 * free_weight_N);
}

INSTANTIATE_TEST_SUITE_P(Models, ElementObjects, testing::ValuesIn(kElementModels),
                         [](const auto& each) { return std::string(name_of(each.param)); });

// A column without Poisson's effect, pulled at its whole top: homogeneous, in closed form.
TEST(ElementObject, AColumnIsPulledAsInClosedForm) {
  for (const ElementModel model : {ElementModel::kCorotated, ElementModel::kStVenantKirchhoff}) {
    const SpringMesh mesh = element_block({2, 3, 4}, kEdge_m, soft(model, 0.0), 0.1);
    ElasticObject<double> object(mesh, precise());
    // A sphere so large that it is a plane just below the top.
    const Vector3d far_above_W(0.0, 0.0, 10.0);
    ASSERT_EQ(object.grab(far_above_W, 10.001), 3 * 4);
    const double stretch = 1.2;
    const double height_m = 4.0 * kEdge_m;
    const Equilibrium found = object.move_to({0.0, 0.0, (stretch - 1.0) * height_m});
    EXPECT_TRUE(found.converged);
    const double mu = 0.5 * 5e3;  // nu = 0
    const double stress_Pa = model == ElementModel::kCorotated
                                 ? 2.0 * mu * (stretch - 1.0)
                                 : mu * stretch * (stretch * stretch - 1.0);
    const double area_m2 = 2.0 * 3.0 * kEdge_m * kEdge_m;
    EXPECT_NEAR(found.force_W.z(), -stress_Pa * area_m2, 1e-8 * stress_Pa * area_m2);
    const std::vector<Vector3d> positions_W = object.positions_W();
    for (std::size_t i = 0; i < positions_W.size(); ++i) {
      const Vector3d& rest_W = mesh.rest_position_W[i];
      const Vector3d expected_W(rest_W.x(), rest_W.y(),
                                stretch * (rest_W.z() + height_m) - height_m);
      EXPECT_LT((positions_W[i] - expected_W).norm(), 1e-9);
    }
  }
}

TEST(ElementObject, StandsBesideSpringsAndOnHomeSprings) {
  SpringMesh mesh = element_block({3, 3, 2}, kEdge_m, soft(ElementModel::kNeoHookean), 0.1);
  mesh.fixed.assign(mesh.fixed.size(), 0);
  mesh.home_stiffness_N_per_m.assign(mesh.fixed.size(), 2.0);
  mesh.springs = {{0, 47, 30.0, 0.0, 0}, {5, 40, 20.0, 0.0, 0}};
  const Vector3d displacement_W(0.002, 0.003, 0.004);
  DenseNewton newton(mesh, Vector3d::Zero(), kPatch_m);
  const Vector3d expected_W = newton.force_at(displacement_W);
  ElasticObject<double> object(mesh, precise());
  object.grab(Vector3d::Zero(), kPatch_m);
  const Vector3d found_W = object.move_to(displacement_W).force_W;
  EXPECT_LT((found_W - expected_W).norm(), 1e-8 * expected_W.norm());
}

TEST(ElementObject, ForcesGrowWithTheScale) {
  SpringMesh mesh = element_block({3, 3, 2}, kEdge_m, soft(ElementModel::kNeoHookean));
  const auto force_W = [](const SpringMesh& of) {
    ElasticObject<double> object(of, precise());
    object.grab(Vector3d::Zero(), kPatch_m);
    return object.move_to({0.0, 0.001, 0.002}).force_W;
  };
  const Vector3d before_W = force_W(mesh);
  scale_forces(mesh, 3.0);
  EXPECT_LT((force_W(mesh) - 3.0 * before_W).norm(), 1e-8 * before_W.norm());
}

TEST(ElementObject, WhatKnowsSpringsOnlyRefusesElements) {
  const SpringMesh mesh = element_block({2, 2, 2}, kEdge_m, soft(ElementModel::kCorotated));
  EXPECT_THROW(PressedSprings{mesh}, Error);
}

TEST(ElementObject, RefusesElementsWithoutVolumeOrMaterial) {
  const SpringMesh good = element_block({2, 2, 2}, kEdge_m, soft(ElementModel::kCorotated));
  SpringMesh mesh = good;
  mesh.tetrahedra[3].material = 1;
  EXPECT_THROW(check(mesh), Error);
  mesh = good;
  mesh.tetrahedra[3].vertex[1] = mesh.tetrahedra[3].vertex[2];
  EXPECT_THROW(check(mesh), Error);
  mesh = good;
  mesh.materials[0].poissons_ratio = 0.5;
  EXPECT_THROW(check(mesh), Error);
  mesh = good;
  mesh.tetrahedra[0].vertex = {0, 1, 2, 3};  // in one line
  EXPECT_THROW(check(mesh), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
