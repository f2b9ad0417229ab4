// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/tangent_stiffness.h"

#include <cmath>

#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d spring_stiffness_W(const SpringMesh& mesh, const Spring& spring, const Vector3d& d_m) {
  const SpringLaw& law = mesh.laws[static_cast<std::size_t>(spring.law)];
  const double l0_m = natural_length_m(mesh, spring);
  const double length_m = d_m.norm();
  const double e = length_m / l0_m - 1.0;
  const double a = law.exponent;
  const double g = a > 0.0 ? std::sinh(a * e) / a : e;
  const double slope = a > 0.0 ? std::cosh(a * e) : 1.0;
  const double c = law.cubic_coefficient;
  const double k = spring.stiffness_N_per_m;
  const double t = k * l0_m * (g + c * e * e * e) / length_m;
  const Vector3d u = d_m / length_m;
  return (k * (slope + 3.0 * c * e * e) - t) * u * u.transpose() + t * Matrix3d::Identity();
}

FreeCoordinates::FreeCoordinates(const SpringMesh& mesh) : first(mesh.fixed.size(), -1) {
  for (std::size_t i = 0; i < first.size(); ++i) {
    if (mesh.fixed[i] == 0) {
      first[i] = count;
      count += 3;
    }
  }
}

Eigen::SparseMatrix<double> tangent_stiffness_W(const SpringMesh& mesh,
                                                const FreeCoordinates& coordinates,
                                                const std::vector<Vector3d>& position_W) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * mesh.springs.size() + 144 * mesh.tetrahedra.size());
  const auto add = [&entries](Eigen::Index row, Eigen::Index column, const Matrix3d& block) {
    if (row < 0 || column < 0) {
      return;
    }
    for (Eigen::Index i = 0; i < 3; ++i) {
      for (Eigen::Index j = 0; j < 3; ++j) {
        entries.emplace_back(row + i, column + j, block(i, j));
      }
    }
  };
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    const Matrix3d h = spring_stiffness_W(mesh, spring, position_W[b] - position_W[a]);
    add(coordinates.first[a], coordinates.first[a], h);
    add(coordinates.first[b], coordinates.first[b], h);
    add(coordinates.first[a], coordinates.first[b], -h);
    add(coordinates.first[b], coordinates.first[a], -h);
  }
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const ElementShape shape = element_shape(unstrained_W(mesh), element);
    const Eigen::Matrix<double, 12, 12> k =
        element_stiffness_W(shape, mesh.materials[static_cast<std::size_t>(element.material)],
                            deformation_gradient(shape, element, position_W));
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b < 4; ++b) {
        add(coordinates.first[static_cast<std::size_t>(element.vertex[a])],
            coordinates.first[static_cast<std::size_t>(element.vertex[b])],
            k.block<3, 3>(3 * static_cast<Eigen::Index>(a), 3 * static_cast<Eigen::Index>(b)));
      }
    }
  }
  for (std::size_t i = 0; i < mesh.home_stiffness_N_per_m.size(); ++i) {
    add(coordinates.first[i], coordinates.first[i],
        mesh.home_stiffness_N_per_m[i] * Matrix3d::Identity());
  }
  Eigen::SparseMatrix<double> stiffness(coordinates.count, coordinates.count);
  stiffness.setFromTriplets(entries.begin(), entries.end());
  return stiffness;
}

}  // namespace forcegrid::simulator
