// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <utility>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/tangent_stiffness.h"

namespace forcegrid::simulator {

/// Newton's method with a dense factor on the scalar reference's forces and Hessian: another way to
/// the equilibria of small meshes.
struct DenseNewton {
  /// Holds the free vertices within `radius_m` of `point_W`.
  DenseNewton(SpringMesh object, const Eigen::Vector3d& point_W, double radius_m)
      : mesh(std::move(object)), position_W(mesh.rest_position_W) {
    for (std::size_t i = 0; i < position_W.size(); ++i) {
      if (mesh.fixed[i] == 0 && (position_W[i] - point_W).norm() <= radius_m) {
        held.push_back(i);
        mesh.fixed[i] = 1;
      }
    }
  }

  /// [N] On the tool that holds the patch, which goes there in `steps` from the rest shape.
  Eigen::Vector3d force_at(const Eigen::Vector3d& displacement_W, int steps = 8) {
    constexpr double kSettled_m = 1e-12;  // the error left is its square
    const FreeCoordinates free(mesh);
    const std::vector<Eigen::Vector3d> rest_W = mesh.rest_position_W;
    for (int step = 1; step <= steps; ++step) {
      for (const std::size_t i : held) {
        position_W[i] = rest_W[i] + step * displacement_W / steps;
      }
      for (int iteration = 0; iteration < 12; ++iteration) {
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
        if (move_m.lpNorm<Eigen::Infinity>() < kSettled_m) {
          break;
        }
      }
    }
    Eigen::Vector3d sum_W = Eigen::Vector3d::Zero();
    const std::vector<Eigen::Vector3d> force_W = vertex_forces_W(mesh, position_W);
    for (const std::size_t i : held) {
      sum_W += force_W[i];
    }
    return sum_W;
  }

  SpringMesh mesh;
  std::vector<Eigen::Vector3d> position_W;
  std::vector<std::size_t> held;
};

}  // namespace forcegrid::simulator
