// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/tangent_stiffness.h"

namespace forcegrid::simulator {

/// Newton's method with a dense factor for an object that two tools hold from rest on: another way
/// to the equilibria of small meshes, on the scalar reference's forces and Hessian.
struct TwoToolNewton {
  using Points = std::array<Eigen::Vector3d, 2>;
  struct Forces {
    Points tool_W;                                       ///< [N] on each tool
    Eigen::Vector3d ground_W = Eigen::Vector3d::Zero();  ///< [N] on what holds the fixed ones
    double residual_N = 0.0;                             ///< on the free vertices
  };

  TwoToolNewton(SpringMesh object, const Points& point_W, double radius_m)
      : mesh(std::move(object)), position_W(mesh.rest_position_W), ground(mesh.fixed) {
    for (std::size_t k = 0; k < 2; ++k) {
      for (std::size_t i = 0; i < position_W.size(); ++i) {
        if (mesh.fixed[i] == 0 && (position_W[i] - point_W[k]).norm() <= radius_m) {
          held[k].push_back(i);
          mesh.fixed[i] = 1;
        }
      }
    }
  }

  /// With the tools there, in `steps` straight from the rest shape.
  Forces at(const Points& displacement_W, int steps = 10) {
    position_W = mesh.rest_position_W;
    const FreeCoordinates free(mesh);
    for (int step = 1; step <= steps; ++step) {
      for (std::size_t k = 0; k < 2; ++k) {
        for (const std::size_t i : held[k]) {
          position_W[i] = mesh.rest_position_W[i] + step * displacement_W[k] / steps;
        }
      }
      for (int iteration = 0; iteration < 12 && free.count > 0; ++iteration) {
        const std::vector<Eigen::Vector3d> force_W = vertex_forces_W(mesh, position_W);
        Eigen::VectorXd residual(free.count);
        for (std::size_t i = 0; i < force_W.size(); ++i) {
          if (free.first[i] >= 0) {
            residual.segment<3>(free.first[i]) = force_W[i];
          }
        }
        const Eigen::VectorXd move_m =
            Eigen::MatrixXd(tangent_stiffness_W(mesh, free, position_W)).llt().solve(residual);
        for (std::size_t i = 0; i < force_W.size(); ++i) {
          if (free.first[i] >= 0) {
            position_W[i] += move_m.segment<3>(free.first[i]);
          }
        }
        if (move_m.lpNorm<Eigen::Infinity>() < 1e-12) {
          break;
        }
      }
    }
    return forces(mesh, position_W, held, ground);
  }

  /// What the object's state `at_W` exerts.
  static Forces forces(const SpringMesh& mesh, const std::vector<Eigen::Vector3d>& at_W,
                       const std::array<std::vector<std::size_t>, 2>& held,
                       const std::vector<std::uint8_t>& ground) {
    Forces sums;
    sums.tool_W = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    const std::vector<Eigen::Vector3d> force_W = vertex_forces_W(mesh, at_W);
    std::vector<std::uint8_t> known = ground;
    for (std::size_t k = 0; k < 2; ++k) {
      for (const std::size_t i : held[k]) {
        sums.tool_W[k] += force_W[i];
        known[i] = 1;
      }
    }
    for (std::size_t i = 0; i < force_W.size(); ++i) {
      if (ground[i] != 0) {
        sums.ground_W += force_W[i];
      }
      if (known[i] == 0) {
        sums.residual_N = std::hypot(sums.residual_N, force_W[i].norm());
      }
    }
    return sums;
  }

  SpringMesh mesh;
  std::vector<Eigen::Vector3d> position_W;
  std::vector<std::uint8_t> ground;
  std::array<std::vector<std::size_t>, 2> held;
};

}  // namespace forcegrid::simulator
