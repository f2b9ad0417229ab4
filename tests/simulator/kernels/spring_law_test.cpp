// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

// Vertex 0 fixed, vertex 1 above it at the natural length of 0.1 m.
SpringMesh one_spring(SpringLaw law) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, -0.1}, {0, 0, 0}};
  mesh.fixed = {1, 0};
  mesh.springs = {{0, 1, 50.0}};
  mesh.laws = {law};
  return mesh;
}

template <typename Real>
class SpringLaws : public ::testing::Test {};
using Precisions = ::testing::Types<float, double>;
TYPED_TEST_SUITE(SpringLaws, Precisions);

TYPED_TEST(SpringLaws, OneSpringPullsAsItsLawSays) {
  constexpr double kSingle = 3e-6;  // relative: strains are differences of single precision
  const double tolerance = std::is_same_v<TypeParam, float> ? kSingle : 1e-12;
  for (const SpringLaw law : {SpringLaw{}, SpringLaw{5.0, 0.0}, SpringLaw{0.0, 4.0},
                              SpringLaw{2.0, 12.0}, SpringLaw{0.0, 0.5}}) {
    ElasticObject<TypeParam> object(one_spring(law));
    ASSERT_EQ(object.grab(Vector3d::Zero(), 0.01), 1);
    for (const double strain : {-0.3, -0.02, 0.001, 0.05, 0.24, 0.6, 1.0}) {
      const double g =
          law.exponent > 0.0 ? std::sinh(law.exponent * strain) / law.exponent : strain;
      const double expected_N = -50.0 * 0.1 * (g + law.cubic_coefficient * std::pow(strain, 3));
      const Equilibrium result = object.move_to({0, 0, 0.1 * strain});
      EXPECT_NEAR(
          result.force_W.z(), expected_N,
          tolerance * (std::abs(expected_N) + 50.0 * 0.1 * std::cosh(law.exponent * strain)))
          << "c " << law.cubic_coefficient << " a " << law.exponent << " strain " << strain;
    }
  }
}

TEST(VertexForces, AreTheClosedFormOfSpringHomeAndLoad) {
  SpringMesh mesh = one_spring({0.0, 4.0});
  mesh.springs[0].natural_length_m = 0.08;
  mesh.home_stiffness_N_per_m = {7.0, 3.0};
  mesh.load_W_N = {{0, 0, 0}, {0.1, 0.2, 0.3}};
  const auto force_W = vertex_forces_W(mesh, {{0, 0, -0.1}, {0, 0, 0.02}});
  const double tension_N = 50.0 * 0.08 * std::sinh(4.0 * (0.12 / 0.08 - 1.0)) / 4.0;
  EXPECT_NEAR(force_W[0].z(), tension_N, 1e-12);
  EXPECT_NEAR(force_W[1].z(), -tension_N - 3.0 * 0.02 + 0.3, 1e-12);
  EXPECT_NEAR(force_W[1].x(), 0.1, 1e-15);
}

SpringMesh tight_block() {
  LatticeBlockOptions options;
  options.vertex_count = {5, 5, 5};
  options.size_m = {0.04, 0.04, 0.04};
  options.law = {0.0, 4.0};
  SpringMesh mesh = make_lattice_block(options);
  tighten(mesh, 0.3, 2.0);
  check(mesh);
  return mesh;
}

TYPED_TEST(SpringLaws, ATightBlockWithHomeSpringsIsInEquilibriumAndItsStiffnessIsTheSlope) {
  const SpringMesh mesh = tight_block();
  SolverOptions options;
  options.relative_tolerance = std::is_same_v<TypeParam, float> ? 1e-5 : 1e-9;
  options.sensitivity_tolerance = 1e-3;
  ElasticObject<TypeParam> object(mesh, options);
  ASSERT_GT(object.grab(Vector3d::Zero(), 0.011), 4);
  EXPECT_LT(object.move_to(Vector3d::Zero()).force_W.norm(), 1e-5);
  const Vector3d displacement_W(0.004, -0.003, 0.006);
  const Equilibrium result = object.move_to(displacement_W);
  ASSERT_TRUE(result.converged);
  const std::vector<Vector3d> force_W = vertex_forces_W(mesh, object.positions_W());
  std::vector<std::uint8_t> held(mesh.fixed.begin(), mesh.fixed.end());
  Vector3d on_tool_W = Vector3d::Zero();
  for (const std::int32_t vertex : object.patch()) {
    held[static_cast<std::size_t>(vertex)] = 1;
    on_tool_W += force_W[static_cast<std::size_t>(vertex)];
  }
  double left_N2 = 0.0;
  for (std::size_t i = 0; i < force_W.size(); ++i) {
    left_N2 += held[i] != 0 ? 0.0 : force_W[i].squaredNorm();
  }
  const double force_N = on_tool_W.norm();
  EXPECT_GT(force_N, 0.1);
  const double tolerance = std::is_same_v<TypeParam, float> ? 1e-4 : 1e-8;
  EXPECT_LT(std::sqrt(left_N2), tolerance * force_N);
  EXPECT_LT((result.force_W - on_tool_W).norm(), tolerance * force_N);
  constexpr double kStep_m = 1e-4;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step_W = kStep_m * Vector3d::Unit(axis);
    const Vector3d ahead_W = object.move_to(displacement_W + step_W).force_W;
    const Vector3d behind_W = object.move_to(displacement_W - step_W).force_W;
    const Vector3d slope_W = (ahead_W - behind_W) / (2.0 * kStep_m);
    EXPECT_LT((result.stiffness_W.col(axis) - slope_W).norm(), 0.01 * slope_W.norm());
  }
}

TEST(SpringMesh, RefusesARestShapeOutOfBalance) {
  SpringMesh mesh = tight_block();
  mesh.load_W_N[60].z() += 1e-3;
  try {
    check(mesh);
    ADD_FAILURE() << "it was taken";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("is left on free vertex 60"));
  }
}

TEST(SpringMesh, ScalingItsForcesScalesTheToolsForceAlike) {
  SpringMesh mesh = tight_block();
  const auto force_of = [](const SpringMesh& object_mesh) -> Vector3d {
    SolverOptions options;
    options.relative_tolerance = 1e-9;
    ElasticObject<double> object(object_mesh, options);
    object.grab(Vector3d::Zero(), 0.011);
    return object.move_to({0.002, 0.0, 0.003}).force_W;
  };
  const Vector3d before_W = force_of(mesh);
  scale_forces(mesh, 2.5);
  check(mesh);
  EXPECT_LT((force_of(mesh) - 2.5 * before_W).norm(), 1e-6 * before_W.norm());
}

}  // namespace
}  // namespace forcegrid::simulator
