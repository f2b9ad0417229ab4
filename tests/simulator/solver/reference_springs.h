// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator::testing {

/// The springs' laws written down again, plainly and in double, from f = k l0 (e + c e^3).
inline double energy_J(const SpringMesh& mesh, const std::vector<Eigen::Vector3d>& x_W) {
  double sum_J = 0.0;
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    const double l0_m = (mesh.rest_position_W[a] - mesh.rest_position_W[b]).norm();
    const double e = (x_W[a] - x_W[b]).norm() / l0_m - 1.0;
    const double c = mesh.laws.front().cubic_coefficient;
    sum_J +=
        spring.stiffness_N_per_m * l0_m * l0_m * (std::pow(e, 2) / 2.0 + c * std::pow(e, 4) / 4.0);
  }
  return sum_J;
}

/// [N] The springs' force on each vertex.
inline std::vector<Eigen::Vector3d> forces_W(const SpringMesh& mesh,
                                             const std::vector<Eigen::Vector3d>& x_W) {
  std::vector<Eigen::Vector3d> force(x_W.size(), Eigen::Vector3d::Zero());
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    const double l0_m = (mesh.rest_position_W[a] - mesh.rest_position_W[b]).norm();
    const Eigen::Vector3d d = x_W[b] - x_W[a];
    const double e = d.norm() / l0_m - 1.0;
    const double tension_N =
        spring.stiffness_N_per_m * l0_m * (e + mesh.laws.front().cubic_coefficient * e * e * e);
    force[a] += tension_N * d.normalized();
    force[b] -= tension_N * d.normalized();
  }
  return force;
}

}  // namespace forcegrid::simulator::testing
