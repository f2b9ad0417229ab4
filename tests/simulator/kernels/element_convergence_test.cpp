// SPDX-License-Identifier: Apache-2.0
// A manufactured solution: the body force that belongs to a given displacement is applied to finer
// and finer meshes of a cube, whose displacements then have to approach it by the second order.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "simulator/mesh/tetrahedra.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kSide_m = 0.04;
constexpr double kLargest_m = 0.002;  // strains of up to 16 %
const Vector3d kAlong(1.0, -0.6, 0.8);

// The cube lies around the z axis with its top at zero.
Vector3d in_unit_cube(const Vector3d& place_W) {
  return (place_W + Vector3d(0.5, 0.5, 1.0) * kSide_m) * (std::numbers::pi / kSide_m);
}

// Zero on all six sides.
Vector3d displacement_m(const Vector3d& place_W) {
  const Vector3d a = in_unit_cube(place_W);
  return kLargest_m * std::sin(a.x()) * std::sin(a.y()) * std::sin(a.z()) * kAlong;
}

Matrix3d gradient(const Vector3d& place_W) {
  const Vector3d a = in_unit_cube(place_W);
  const Vector3d slope(std::cos(a.x()) * std::sin(a.y()) * std::sin(a.z()),
                       std::sin(a.x()) * std::cos(a.y()) * std::sin(a.z()),
                       std::sin(a.x()) * std::sin(a.y()) * std::cos(a.z()));
  return Matrix3d::Identity() +
         kLargest_m * std::numbers::pi / kSide_m * kAlong * slope.transpose();
}

// [N/m^3] -Div P, by differences of the stress.
Vector3d body_force(const ElementMaterial& material, const Vector3d& place_W) {
  constexpr double kStep_m = 1e-6;
  Vector3d sum = Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = kStep_m * Vector3d::Unit(axis);
    sum -= (stress_Pa(material, gradient(place_W + step)) -
            stress_Pa(material, gradient(place_W - step)))
               .col(axis) /
           (2.0 * kStep_m);
  }
  return sum;
}

// Calls `use` at the four points of the rule that is exact for polynomials of the second degree,
// with the hat functions there and the volume of each.
template <typename Use>
void at_points(const SpringMesh& mesh, const Tetrahedron& element, const Use& use) {
  const double near = (5.0 + 3.0 * std::sqrt(5.0)) / 20.0;
  const double far = (5.0 - std::sqrt(5.0)) / 20.0;
  const double volume_m3 = element_shape(mesh.rest_position_W, element).volume_m3;
  for (std::size_t k = 0; k < 4; ++k) {
    std::array<double, 4> hat;
    hat.fill(far);
    hat[k] = near;
    Vector3d place_W = Vector3d::Zero();
    for (std::size_t a = 0; a < 4; ++a) {
      place_W += hat[a] * mesh.rest_position_W[static_cast<std::size_t>(element.vertex[a])];
    }
    use(place_W, hat, 0.25 * volume_m3);
  }
}

SpringMesh cube(int cells, const ElementMaterial& material) {
  SpringMesh mesh = element_block({cells, cells, cells}, kSide_m / cells, material, 0.15, 7);
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    const Vector3d a = in_unit_cube(mesh.rest_position_W[i]);
    const double inside =
        std::min(a.minCoeff(), (Vector3d::Constant(std::numbers::pi) - a).minCoeff());
    mesh.fixed[i] = inside < 1e-9 ? 1 : 0;
  }
  mesh.load_W_N.assign(mesh.rest_position_W.size(), Vector3d::Zero());
  for (const Tetrahedron& element : mesh.tetrahedra) {
    at_points(mesh, element,
              [&](const Vector3d& place_W, const std::array<double, 4>& hat, double volume_m3) {
                const Vector3d force_N = volume_m3 * body_force(material, place_W);
                for (std::size_t a = 0; a < 4; ++a) {
                  mesh.load_W_N[static_cast<std::size_t>(element.vertex[a])] += hat[a] * force_N;
                }
              });
  }
  return mesh;
}

// Newton's method with a sparse factor, from the undeformed cube.
std::vector<Vector3d> equilibrium_W(const SpringMesh& mesh) {
  std::vector<int> number(mesh.fixed.size(), -1);
  int free = 0;
  for (std::size_t i = 0; i < mesh.fixed.size(); ++i) {
    number[i] = mesh.fixed[i] != 0 ? -1 : free++;
  }
  std::vector<Vector3d> x_W = mesh.rest_position_W;
  double residual_N = 1.0;
  for (int step = 0; step < 20 && residual_N > 1e-12; ++step) {
    std::vector<Vector3d> force_N = mesh.load_W_N;
    add_element_forces_W(mesh, x_W, force_N);
    std::vector<Eigen::Triplet<double>> entries;
    for (const Tetrahedron& element : mesh.tetrahedra) {
      const ElementShape shape = element_shape(mesh.rest_position_W, element);
      const auto k =
          element_stiffness_W(shape, mesh.materials[0], deformation_gradient(shape, element, x_W));
      for (int r = 0; r < 12; ++r) {
        for (int c = 0; c < 12; ++c) {
          const int row =
              number[static_cast<std::size_t>(element.vertex[static_cast<std::size_t>(r / 3)])];
          const int column =
              number[static_cast<std::size_t>(element.vertex[static_cast<std::size_t>(c / 3)])];
          if (row >= 0 && column >= 0) {
            entries.emplace_back(3 * row + r % 3, 3 * column + c % 3, k(r, c));
          }
        }
      }
    }
    Eigen::SparseMatrix<double> k(3 * free, 3 * free);
    k.setFromTriplets(entries.begin(), entries.end());
    Eigen::VectorXd right(3 * free);
    for (std::size_t i = 0; i < number.size(); ++i) {
      if (number[i] >= 0) {
        right.segment<3>(3 * number[i]) = force_N[i];
      }
    }
    residual_N = right.norm();
    const Eigen::VectorXd move = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(k).solve(right);
    for (std::size_t i = 0; i < number.size(); ++i) {
      if (number[i] >= 0) {
        x_W[i] += move.segment<3>(3 * number[i]);
      }
    }
  }
  EXPECT_LT(residual_N, 1e-10);
  return x_W;
}

// Root of the mean of |u_h - u|^2 over the volume, relative to that of |u|^2.
double error_of(int cells, const ElementMaterial& material) {
  const SpringMesh mesh = cube(cells, material);
  const std::vector<Vector3d> x_W = equilibrium_W(mesh);
  double error = 0.0;
  double whole = 0.0;
  for (const Tetrahedron& element : mesh.tetrahedra) {
    at_points(mesh, element,
              [&](const Vector3d& place_W, const std::array<double, 4>& hat, double volume_m3) {
                Vector3d moved_m = Vector3d::Zero();
                for (std::size_t a = 0; a < 4; ++a) {
                  const auto vertex = static_cast<std::size_t>(element.vertex[a]);
                  moved_m += hat[a] * (x_W[vertex] - mesh.rest_position_W[vertex]);
                }
                error += volume_m3 * (moved_m - displacement_m(place_W)).squaredNorm();
                whole += volume_m3 * displacement_m(place_W).squaredNorm();
              });
  }
  // The object's own check: with these loads it rests where Newton's method has put it.
  SpringMesh at_rest = mesh;
  at_rest.unstrained_W = mesh.rest_position_W;
  at_rest.rest_position_W = x_W;
  EXPECT_NO_THROW(check(at_rest));
  return std::sqrt(error / whole);
}

class ElementConvergence : public testing::TestWithParam<ElementModel> {};

TEST_P(ElementConvergence, DisplacementsApproachAManufacturedSolutionByTheSecondOrder) {
  const ElementMaterial material = soft(GetParam(), 0.3);
  const double coarse = error_of(3, material);
  const double middle = error_of(6, material);
  const double fine = error_of(12, material);
  // It rises to two as the mesh gets finer: 1.88 from 8 to 16 cells, which takes ten times as long.
  const double order_before = std::log2(coarse / middle);
  const double order = std::log2(middle / fine);
  EXPECT_LT(fine, 0.04);
  EXPECT_GT(order_before, 1.5);
  EXPECT_GT(order, 1.75);
  EXPECT_GT(order, order_before + 0.1);
  EXPECT_LT(order, 2.2);
  RecordProperty("order", std::to_string(order));
}

INSTANTIATE_TEST_SUITE_P(Models, ElementConvergence, testing::ValuesIn(kElementModels),
                         [](const auto& each) { return name_of(each.param); });

}  // namespace
}  // namespace forcegrid::simulator
