// SPDX-License-Identifier: Apache-2.0
// Finite elements with inertia.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numeric>
#include <vector>

#include "simulator/mesh/tangent_stiffness.h"
#include "simulator/mesh/tetrahedra.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/solver/dynamic_object.h"
#include "simulator/solver/elastic_object.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kPatch_m = 0.012;

SpringMesh dynamic_block(ElementModel model, double retardation_time_s) {
  SpringMesh mesh = element_block({3, 3, 3}, 0.01, soft(model, 0.35), 0.15);
  const std::vector<double> masses_kg = element_masses_kg(mesh);
  give_dynamics(mesh, {.mass_kg = std::accumulate(masses_kg.begin(), masses_kg.end(), 0.0),
                       .retardation_time_s = retardation_time_s});
  return mesh;
}

double potential_J(const SpringMesh& mesh, const std::vector<Vector3d>& position_W) {
  double sum_J = 0.0;
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const ElementShape shape = element_shape(unstrained_W(mesh), element);
    sum_J +=
        shape.volume_m3 *
        strain_energy_J_per_m3(mesh.materials[0], deformation_gradient(shape, element, position_W));
  }
  return sum_J;
}

double energy_J(const SpringMesh& mesh, const DynamicObject& object) {
  double sum_J = potential_J(mesh, object.positions_W()) - potential_J(mesh, mesh.rest_position_W);
  const std::vector<Vector3d> velocity_W = object.velocities_W();
  for (std::size_t i = 0; i < velocity_W.size(); ++i) {
    sum_J += 0.5 * mesh.mass_kg[i] * velocity_W[i].squaredNorm();
  }
  return sum_J;
}

class ElementDynamics : public testing::TestWithParam<ElementModel> {};

TEST_P(ElementDynamics, ComeToTheEquilibriumThatTheQuasiStaticSolverFinds) {
  const SpringMesh mesh = dynamic_block(GetParam(), 0.02);
  DynamicObject object(mesh, {.relative_tolerance = 1e-7});
  ElasticObject<double> still(mesh, {.relative_tolerance = 1e-7});
  ASSERT_EQ(object.grab(mesh.top_W, kPatch_m), still.grab(mesh.top_W, kPatch_m));
  const Vector3d there_W(0.003, -0.002, -0.004);
  Equilibrium reached;
  for (int n = 0; n < 40; ++n) {
    reached = object.advance(0.05, there_W);
  }
  EXPECT_TRUE(reached.converged);
  const Vector3d expected_W = still.move_to(there_W).force_W;
  EXPECT_LT((reached.force_W - expected_W).norm(), 1e-4 * expected_W.norm());
}

TEST_P(ElementDynamics, EnergyBalancesOverAThousandSteps) {
  for (const double tau_s : {0.0, 0.004}) {
    const SpringMesh mesh = dynamic_block(GetParam(), tau_s);
    DynamicObject object(mesh, {.step_s = 2e-4, .relative_tolerance = 1e-8});
    ASSERT_GT(object.grab(mesh.top_W, kPatch_m), 0);
    double work_J = 0.0;
    Vector3d at_W = Vector3d::Zero();
    Vector3d force_W = Vector3d::Zero();
    for (int n = 1; n <= 50; ++n) {  // slowly, so that the held vertices' inertia is little
      const Vector3d to_W = n / 50.0 * Vector3d(0.002, 0.001, 0.003);
      const Vector3d next_W = object.advance(4e-3, to_W).force_W;
      work_J -= 0.5 * (force_W + next_W).dot(to_W - at_W);
      at_W = to_W;
      force_W = next_W;
    }
    const double begun_J = energy_J(mesh, object);
    EXPECT_GT(begun_J, 1e-5);
    // What was put in is there, but for what the dampers and the method took.
    EXPECT_LT(begun_J, 1.02 * work_J);
    EXPECT_GT(begun_J, 0.8 * work_J);
    object.release();
    double before_J = begun_J;
    for (int n = 0; n < 1000; ++n) {
      object.advance(2e-4, Vector3d::Zero());
      const double now_J = energy_J(mesh, object);
      ASSERT_LE(now_J, before_J + 2e-4 * begun_J) << "step " << n << ", tau " << tau_s << " s";
      before_J = now_J;
    }
    EXPECT_LT(before_J, begun_J);
  }
}

TEST_P(ElementDynamics, SwingAtTheFrequencyOfTheLowestMode) {
  const SpringMesh mesh = dynamic_block(GetParam(), 0.0);
  const FreeCoordinates free(mesh);
  Eigen::VectorXd masses_kg(free.count);
  for (std::size_t i = 0; i < mesh.mass_kg.size(); ++i) {
    if (free.first[i] >= 0) {
      masses_kg.segment<3>(free.first[i]).setConstant(mesh.mass_kg[i]);
    }
  }
  const Eigen::MatrixXd stiffness(tangent_stiffness_W(mesh, free, mesh.rest_position_W));
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> modes(
      stiffness, Eigen::MatrixXd(masses_kg.asDiagonal()));
  const double period_s = 2.0 * M_PI / std::sqrt(modes.eigenvalues()[0]);
  // The two lowest modes sway in x and y and are nearly alike: pull along the first one.
  Vector3d along_W = Vector3d::Zero();
  for (std::size_t i = 0; i < mesh.mass_kg.size(); ++i) {
    if (free.first[i] >= 0) {
      along_W += modes.eigenvectors().col(0).segment<3>(free.first[i]);
    }
  }
  DynamicObject object(mesh, {.step_s = 1e-4, .relative_tolerance = 1e-8});
  ASSERT_GT(object.grab({0.0, 0.0, 10.0}, 10.001), 0);  // the whole top
  const Vector3d pulled_W = 2e-4 * along_W.normalized();
  for (int n = 1; n <= 100; ++n) {
    object.advance(0.002, std::min(1.0, n / 40.0) * pulled_W);
  }
  object.release();
  // The time of ten swings, from crossings of the top's middle.
  const std::size_t top = 3 * 16 + 5;
  double last = 0.0;
  int crossings = 0;
  double first_s = 0.0;
  double last_s = 0.0;
  for (int n = 1; n <= 12000 && crossings < 7; ++n) {
    object.advance(1e-4, Vector3d::Zero());
    const double now = (object.positions_W()[top] - mesh.rest_position_W[top]).dot(pulled_W);
    if (last > 0.0 && now <= 0.0) {
      const double at_s = 1e-4 * (n - 1 + last / (last - now));
      if (crossings == 0) {
        first_s = at_s;
      }
      last_s = at_s;
      ++crossings;
    }
    last = now;
  }
  ASSERT_EQ(crossings, 7);
  EXPECT_NEAR((last_s - first_s) / 6.0, period_s, 0.03 * period_s);
}

INSTANTIATE_TEST_SUITE_P(Models, ElementDynamics, testing::ValuesIn(kElementModels),
                         [](const auto& each) { return std::string(name_of(each.param)); });

}  // namespace
}  // namespace forcegrid::simulator
