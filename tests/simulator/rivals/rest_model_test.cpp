// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/rest_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/tangent_stiffness.h"
#include "tests/simulator/rivals/little_blocks.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using ::testing::HasSubstr;

// K by central differences of the forces, which are computed elsewhere.
MatrixXd differenced_stiffness(const SpringMesh& mesh) {
  constexpr double kStep_m = 1e-6;
  const FreeCoordinates coordinates(mesh);
  MatrixXd stiffness(coordinates.count, coordinates.count);
  std::vector<Vector3d> position_W = mesh.rest_position_W;
  for (std::size_t j = 0; j < position_W.size(); ++j) {
    for (Index c = 0; coordinates.first[j] >= 0 && c < 3; ++c) {
      position_W[j][c] = mesh.rest_position_W[j][c] + kStep_m;
      const std::vector<Vector3d> after_W = vertex_forces_W(mesh, position_W);
      position_W[j][c] = mesh.rest_position_W[j][c] - kStep_m;
      const std::vector<Vector3d> before_W = vertex_forces_W(mesh, position_W);
      position_W[j][c] = mesh.rest_position_W[j][c];
      for (std::size_t i = 0; i < position_W.size(); ++i) {
        if (coordinates.first[i] >= 0) {
          stiffness.block<3, 1>(coordinates.first[i], coordinates.first[j] + c) =
              (before_W[i] - after_W[i]) / (2.0 * kStep_m);
        }
      }
    }
  }
  return stiffness;
}

MatrixXd part_of(const MatrixXd& matrix, const FreeCoordinates& coordinates,
                 const std::vector<std::int32_t>& rows, const std::vector<std::int32_t>& columns) {
  MatrixXd part(3 * rows.size(), 3 * columns.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t j = 0; j < columns.size(); ++j) {
      part.block<3, 3>(static_cast<Index>(3 * i), static_cast<Index>(3 * j)) =
          matrix.block<3, 3>(coordinates.first[static_cast<std::size_t>(rows[i])],
                             coordinates.first[static_cast<std::size_t>(columns[j])]);
    }
  }
  return part;
}

double relative_difference(const MatrixXd& a, const MatrixXd& b) {
  return (a - b).norm() / b.norm();
}

// With home springs, pre-strain and a law that bends, so that every term of K is there.
SpringMesh tightened() {
  SpringMesh mesh = testing::block_with(0.3, 5.0);
  tighten(mesh, 0.2, 3.0);
  return mesh;
}

std::vector<std::int32_t> free_vertices(const SpringMesh& mesh,
                                        const std::vector<std::int32_t>& without) {
  std::vector<std::int32_t> others;
  for (std::size_t i = 0; i < mesh.fixed.size(); ++i) {
    const auto vertex = static_cast<std::int32_t>(i);
    if (mesh.fixed[i] == 0 && std::find(without.begin(), without.end(), vertex) == without.end()) {
      others.push_back(vertex);
    }
  }
  return others;
}

TEST(TangentStiffness, IsTheDerivativeOfTheForces) {
  const SpringMesh mesh = tightened();
  const MatrixXd stiffness = tangent_stiffness_W(mesh, FreeCoordinates(mesh), mesh.rest_position_W);
  EXPECT_LT(relative_difference(stiffness, differenced_stiffness(mesh)), 1e-7);
  EXPECT_LT((stiffness - stiffness.transpose()).norm(), 1e-12 * stiffness.norm());
}

// Against a dense inverse of the differenced stiffness.
TEST(RestModel, AgreesWithADenseInverse) {
  const SpringMesh mesh = tightened();
  const FreeCoordinates coordinates(mesh);
  const MatrixXd stiffness = differenced_stiffness(mesh);
  const std::vector<std::int32_t> nodes = vertices_within(mesh, testing::kTop_W, 0.033);
  ASSERT_GT(nodes.size(), 10U);
  const MatrixXd inverse = stiffness.inverse();
  EXPECT_LT(relative_difference(greens_functions_m_per_N(mesh, nodes),
                                part_of(inverse, coordinates, nodes, nodes)),
            1e-6);

  const std::vector<std::int32_t> inner = free_vertices(mesh, nodes);
  const MatrixXd k_si = part_of(stiffness, coordinates, nodes, inner);
  const MatrixXd condensed = part_of(stiffness, coordinates, nodes, nodes) -
                             k_si * part_of(stiffness, coordinates, inner, inner).inverse() *
                                 part_of(stiffness, coordinates, inner, nodes);
  EXPECT_LT(relative_difference(condensed_stiffness_N_per_m(mesh, nodes), condensed), 1e-6);

  const std::vector<std::int32_t> patch = vertices_within(mesh, testing::kTop_W, testing::kGrip_m);
  ASSERT_EQ(patch.size(), 4U);
  MatrixXd ones(12, 3);
  for (Index i = 0; i < 4; ++i) {
    ones.middleRows<3>(3 * i).setIdentity();
  }
  const MatrixXd force =
      -ones.transpose() * part_of(inverse, coordinates, patch, patch).inverse() * ones;
  EXPECT_LT(relative_difference(rest_stiffness_W(mesh, patch), force), 1e-6);
}

TEST(RestModel, TheTwoTablesAreEachOthersInverseOnEveryScene) {
  for (const char* name : {"small", "small_linear", "stomach"}) {
    SCOPED_TRACE(name);
    const Scene scene = make_scene(name);
    const std::vector<std::int32_t> nodes = vertices_within(scene.mesh, scene.mesh.top_W, 0.020);
    const MatrixXd greens = greens_functions_m_per_N(scene.mesh, nodes);
    const MatrixXd product = condensed_stiffness_N_per_m(scene.mesh, nodes) * greens;
    EXPECT_LT((product - MatrixXd::Identity(product.rows(), product.cols())).norm(),
              1e-8 * std::sqrt(static_cast<double>(product.rows())));
    EXPECT_LT((greens - greens.transpose()).norm(), 1e-10 * greens.norm());
  }
}

// Two springs in a row behave as one of k1 k2 / (k1 + k2), and home springs hold them sideways.
TEST(RestModel, HasTheStiffnessOfSpringsInARow) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.2, 0.0, 0.0}};
  mesh.fixed = {1, 0, 0};
  mesh.springs = {{0, 1, 30.0}, {1, 2, 60.0}};
  mesh.home_stiffness_N_per_m = {0.0, 0.0, 0.0};
  tighten(mesh, 0.0, 1e-3);
  const double home = 1e-3;
  const double in_a_row = 60.0 - 60.0 * 60.0 / (30.0 + 60.0 + home) + home;
  EXPECT_NEAR(condensed_stiffness_N_per_m(mesh, {2})(0, 0), in_a_row, 1e-9);
  EXPECT_NEAR(greens_functions_m_per_N(mesh, {2})(0, 0), 1.0 / in_a_row, 1e-9);
  EXPECT_NEAR(rest_stiffness_W(mesh, {2})(0, 0), -in_a_row, 1e-9);
  EXPECT_NEAR(greens_functions_m_per_N(mesh, {1, 2})(4, 4), 1.0 / home, 1e-6);
}

std::string complaint_of_greens(const SpringMesh& mesh, const std::vector<std::int32_t>& nodes) {
  try {
    greens_functions_m_per_N(mesh, nodes);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(RestModel, RefusesWhatItCantSolve) {
  const SpringMesh mesh = testing::block_with(0.3, 0.0);
  EXPECT_THAT(complaint_of_greens(mesh, {0}), HasSubstr("vertex 0 is fixed or missing"));
  EXPECT_THAT(complaint_of_greens(mesh, {100'000}), HasSubstr("is fixed or missing"));
  // Springs that push each other at rest, held only by loads: the rest shape is no stable one.
  SpringMesh unstable;
  unstable.rest_position_W = {{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.2, 0.0, 0.0}};
  unstable.fixed = {1, 0, 1};
  unstable.springs = {{0, 1, 30.0, 0.15}, {1, 2, 30.0, 0.15}};
  EXPECT_THAT(complaint_of_greens(unstable, {1}), HasSubstr("no stable equilibrium"));
  EXPECT_THROW(condensed_stiffness_N_per_m(unstable, {1}), Error);
  LatticeBlockOptions large;
  large.vertex_count = {30, 30, 30};
  EXPECT_THAT(complaint_of_greens(make_lattice_block(large), {26'999}),
              HasSubstr("26100 free vertices"));
}

}  // namespace
}  // namespace forcegrid::simulator
