// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/element_forces.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numeric>
#include <random>
#include <vector>

#include "simulator/kernels/eigen_lanes.h"
#include "simulator/mesh/tangent_stiffness.h"
#include "simulator/mesh/tetrahedra.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using kernels::Lanes;

constexpr unsigned kSeed = 7;
constexpr double kEdge_m = 0.01;

// An object of all three energies, 5 * 4 * 3 cells, strongly deformed and turned around.
struct Deformed {
  Deformed() {
    mesh = element_block({5, 4, 3}, kEdge_m, soft(ElementModel::kCorotated), 0.1, kSeed);
    mesh.materials.push_back(soft(ElementModel::kStVenantKirchhoff, 0.2));
    mesh.materials.push_back(soft(ElementModel::kNeoHookean, 0.45));
    std::mt19937 random(kSeed);
    for (Tetrahedron& element : mesh.tetrahedra) {
      element.material = static_cast<std::int32_t>(random() % 3);
    }
    std::uniform_real_distribution<double> by_m(-0.15 * kEdge_m, 0.15 * kEdge_m);
    std::uniform_real_distribution<float> number(-1.0F, 1.0F);
    const Eigen::AngleAxisd turn(0.9, Vector3d(1.0, 2.0, -1.0).normalized());
    for (const Vector3d& rest_W : mesh.rest_position_W) {
      const Vector3d bent_W(1.2 * rest_W.x() + 5.0 * rest_W.z() * rest_W.z(), 0.9 * rest_W.y(),
                            rest_W.z());
      position_W.emplace_back(turn * bent_W + Vector3d(by_m(random), by_m(random), by_m(random)));
      Lanes lanes{};
      for (auto& component : lanes.component) {
        component = kernels::Float4{0.0F, number(random), number(random), number(random)};
      }
      state.push_back(lanes);
    }
  }
  SpringMesh mesh;
  std::vector<Vector3d> position_W;
  std::vector<Lanes> state;  // S at random
};

// K of all vertices, fixed ones included.
Eigen::MatrixXd dense_stiffness(SpringMesh mesh, const std::vector<Vector3d>& position_W) {
  mesh.fixed.assign(mesh.fixed.size(), 0);
  return tangent_stiffness_W(mesh, FreeCoordinates(mesh), position_W);
}

// Evaluated forces and -K S, by vertex of the mesh.
struct Found {
  Eigen::VectorXd force_N;
  Eigen::MatrixXd sensitivity_N_per_m;  // one column per lane
};

template <typename Real>
Found evaluate(ElementForces<Real>& forces, const Deformed& object,
               const std::vector<std::int32_t>& order, std::vector<Lanes>* product = nullptr,
               kernels::Float4* dot = nullptr) {
  const std::size_t n = order.size();
  std::vector<Lanes> state(n);
  std::vector<Lanes> residual(n, Lanes{});
  std::vector<typename ForceModel<Real>::Position> position(n);
  std::vector<kernels::Precise> force(n, kernels::Precise{});
  for (std::size_t i = 0; i < n; ++i) {
    const auto old = static_cast<std::size_t>(order[i]);
    state[i] = object.state[old];
    for (int c = 0; c < 3; ++c) {
      position[i].xyz[c] = static_cast<Real>(object.position_W[old][c]);
    }
    position[i].xyz[3] = 0;
  }
  forces.evaluate(state.data(), position.data(), force.data(), residual.data());
  if (product != nullptr) {
    product->assign(n, Lanes{});
    *dot = forces.apply_stiffness(nullptr, state.data(), product->data());
  }
  Found found{Eigen::VectorXd(3 * n), Eigen::MatrixXd(3 * n, 3)};
  for (std::size_t i = 0; i < n; ++i) {
    for (int c = 0; c < 3; ++c) {
      const auto at = static_cast<Eigen::Index>(3 * static_cast<std::size_t>(order[i])) + c;
      found.force_N[at] = std::is_same_v<Real, double>
                              ? force[i].xyz[c]
                              : static_cast<double>(residual[i].component[c][0]);
      for (int j = 0; j < 3; ++j) {
        found.sensitivity_N_per_m(at, j) = static_cast<double>(residual[i].component[c][1 + j]);
      }
    }
  }
  return found;
}

Eigen::VectorXd reference_forces(const Deformed& object) {
  const std::vector<Vector3d> force_W = vertex_forces_W(object.mesh, object.position_W);
  Eigen::VectorXd all(3 * static_cast<Eigen::Index>(force_W.size()));
  for (std::size_t i = 0; i < force_W.size(); ++i) {
    all.segment<3>(3 * static_cast<Eigen::Index>(i)) = force_W[i];
  }
  return all;
}

Eigen::MatrixXd sensitivities(const Deformed& object) {
  Eigen::MatrixXd all(3 * static_cast<Eigen::Index>(object.state.size()), 3);
  for (std::size_t i = 0; i < object.state.size(); ++i) {
    all.middleRows<3>(3 * static_cast<Eigen::Index>(i)) = kernels::sensitivity_of(object.state[i]);
  }
  return all;
}

std::vector<std::int32_t> as_numbered(const Deformed& object) {
  std::vector<std::int32_t> order(object.mesh.rest_position_W.size());
  std::iota(order.begin(), order.end(), 0);
  return order;
}

template <typename Real>
class ElementForcesOf : public testing::Test {
 protected:
  static constexpr double kTolerance = std::is_same_v<Real, double> ? 1e-12 : 2e-5;
};
using Precisions = testing::Types<float, double>;
TYPED_TEST_SUITE(ElementForcesOf, Precisions);

TYPED_TEST(ElementForcesOf, AreThoseOfTheScalarReference) {
  const Deformed object;
  ElementForces<TypeParam> forces(object.mesh);
  const Found found = evaluate(forces, object, as_numbered(object));
  const Eigen::VectorXd expected = reference_forces(object);
  EXPECT_LT((found.force_N - expected).norm(), this->kTolerance * expected.norm());
}

TYPED_TEST(ElementForcesOf, StiffnessIsTheExactHessianOfTheScalarReference) {
  const Deformed object;
  ElementForces<TypeParam> forces(object.mesh);
  std::vector<Lanes> product;
  kernels::Float4 dot{};
  const Found found = evaluate(forces, object, as_numbered(object), &product, &dot);
  const Eigen::MatrixXd s = sensitivities(object);
  const Eigen::MatrixXd expected = dense_stiffness(object.mesh, object.position_W) * s;
  constexpr double kSingle = 2e-5;  // K is stored in single precision
  EXPECT_LT((found.sensitivity_N_per_m + expected).norm(), kSingle * expected.norm());
  for (std::size_t i = 0; i < product.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(3 * i);
    EXPECT_LT((kernels::sensitivity_of(product[i]) - expected.middleRows<3>(at)).norm(),
              1e-4 * expected.norm() / std::sqrt(static_cast<double>(product.size())));
  }
  for (int j = 0; j < 3; ++j) {
    EXPECT_NEAR(static_cast<double>(dot[1 + j]), s.col(j).dot(expected.col(j)),
                1e-4 * s.col(j).norm() * expected.col(j).norm());
  }
}

TYPED_TEST(ElementForcesOf, StayTheSameInAnotherOrder) {
  const Deformed object;
  ElementForces<TypeParam> forces(object.mesh);
  std::vector<std::int32_t> order = as_numbered(object);
  std::shuffle(order.begin(), order.end(), std::mt19937(kSeed));
  forces.renumber(order);
  const Found found = evaluate(forces, object, order);
  const Eigen::VectorXd expected = reference_forces(object);
  EXPECT_LT((found.force_N - expected).norm(), this->kTolerance * expected.norm());
}

TYPED_TEST(ElementForcesOf, ARegionHasTheForcesOfItsActiveVertices) {
  const Deformed object;
  ElementForces<TypeParam> forces(object.mesh);
  const std::vector<std::int32_t> order = as_numbered(object);
  // Vertices below `active` are neighbours of none from `reach` on: one layer of the lattice.
  constexpr std::int32_t kLayer = 6 * 5;
  const std::int32_t active = 2 * kLayer - 11;
  const std::int32_t reach = active + kLayer + 7;
  forces.limit({active, reach});
  const Found found = evaluate(forces, object, order);
  const Eigen::VectorXd expected = reference_forces(object);
  const Eigen::MatrixXd slope =
      dense_stiffness(object.mesh, object.position_W) * sensitivities(object);
  EXPECT_LT((found.force_N - expected).head(3 * active).norm(), this->kTolerance * expected.norm());
  EXPECT_LT((found.sensitivity_N_per_m + slope).topRows(3 * active).norm(), 2e-5 * slope.norm());
  const Eigen::Index beyond = found.force_N.size() - 3 * reach;
  EXPECT_EQ(found.force_N.tail(beyond).norm(), 0.0);
}

TYPED_TEST(ElementForcesOf, BlocksAreTheDiagonalOnes) {
  const Deformed object;
  ElementForces<TypeParam> forces(object.mesh);
  evaluate(forces, object, as_numbered(object));
  std::vector<kernels::BlockInverse> block(object.state.size(), kernels::BlockInverse{});
  forces.add_blocks(block.data());
  const Eigen::MatrixXd k = dense_stiffness(object.mesh, object.position_W);
  for (std::size_t i = 0; i < block.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(3 * i);
    const Eigen::Matrix3d expected = k.block<3, 3>(at, at);
    Eigen::Matrix3d found;
    for (int c = 0; c < 3; ++c) {
      found(c, c) = static_cast<double>(block[i].diagonal[c]);
      found(c, (c + 1) % 3) = found((c + 1) % 3, c) = static_cast<double>(block[i].off_diagonal[c]);
    }
    EXPECT_LT((found - expected).norm(), 1e-4 * expected.norm());
  }
}

TEST(ElementForces, EnergyGrowsByTheWorkAgainstTheForces) {
  const Deformed object;
  ElementForces<double> forces(object.mesh);
  const Eigen::VectorXd force = reference_forces(object);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> by_m(-1e-7, 1e-7);
  std::vector<kernels::Precise> plus;
  std::vector<kernels::Precise> minus;
  double work_J = 0.0;
  for (std::size_t i = 0; i < object.position_W.size(); ++i) {
    const Vector3d by_W(by_m(random), by_m(random), by_m(random));
    plus.push_back(kernels::to_precise(object.position_W[i] + by_W));
    minus.push_back(kernels::to_precise(object.position_W[i] - by_W));
    work_J -= 2.0 * by_W.dot(force.segment<3>(3 * static_cast<Eigen::Index>(i)));
  }
  EXPECT_NEAR(forces.energy_J(plus.data()) - forces.energy_J(minus.data()), work_J,
              1e-5 * std::abs(work_J));
}

// The rotation that the kernels find in closed form, of elements on both sides of collapse.
TEST(ElementForces, SingleElementsAreEvaluatedHoweverTheyAreStretchedAndTurned) {
  SpringMesh mesh;
  mesh.rest_position_W = {Vector3d::Zero(), 0.01 * Vector3d::UnitX(), 0.01 * Vector3d::UnitY(),
                          0.01 * Vector3d::UnitZ()};
  mesh.fixed.assign(4, 0);
  mesh.tetrahedra = {{{0, 1, 2, 3}, 0}};
  mesh.materials = {soft(ElementModel::kCorotated)};
  ElementForces<double> forces(mesh);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> entry(-1.0, 1.0);
  for (const Vector3d& stretch :
       {Vector3d(1.0, 1.0, 1.0), Vector3d(3.0, 1.0, 0.2), Vector3d(1.0, 0.9, -0.4),
        Vector3d(0.05, 0.06, 0.07), Vector3d(2.0, 2.0, -1.0), Vector3d(1.0, 0.5, 0.0)}) {
    const Eigen::Quaterniond u(entry(random), entry(random), entry(random), entry(random));
    const Eigen::Quaterniond v(entry(random), entry(random), entry(random), entry(random));
    const Eigen::Matrix3d f = u.normalized().toRotationMatrix() * stretch.asDiagonal() *
                              v.normalized().toRotationMatrix();
    Deformed object;
    object.mesh = mesh;
    object.position_W.clear();
    object.state.assign(4, Lanes{});
    for (const Vector3d& rest_W : mesh.rest_position_W) {
      object.position_W.emplace_back(f * rest_W);
    }
    const Found found = evaluate(forces, object, as_numbered(object));
    const double scale_N = 5e3 * 1e-4;
    EXPECT_LT((found.force_N - reference_forces(object)).norm(), 1e-9 * scale_N)
        << "stretched by " << stretch.transpose();
  }
}

}  // namespace
}  // namespace forcegrid::simulator
