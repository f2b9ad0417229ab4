// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/pressed_springs.h"

namespace forcegrid::simulator {

/// How the torque on a pressing or grasping tool changes when the tool turns about its position P:
/// T = dx/d(theta) of the vertices, theta the rotation vector in W, and d(torque)/d(theta).
///
///   (K + sum_p w_p C_p w_p^T) T = w_p (C_p M_p + L_p),   M_p = -[l]x,   l = x_p - P
///   torque = -sum_p l x R_p,
///   d(torque)/d(theta) = sum_p ([R_p]x T_p - [l]x (C_p (M_p - T_p) + L_p))
///
/// S = dx/dP is the first one's; with it, C_p and L_p for M_p = 1,
///
///   d(torque)/dP = sum_p ([R_p]x (S_p - 1) - [l]x (C_p (1 - S_p) + L_p))
///
/// L_p is that part of the force's change which C_p does not have: -[R_p]x of a point that is
/// pressed on, whose force turns with the tool, and the constraint's own change, found by the same
/// repeated substitution as ContactPoint::pull_W. The right-hand sides are solved in the lanes of a
/// second PressedSprings at the first one's positions.
///
/// Not for points that slip with friction: their force is no function of the pose.
/// Real-time: no allocation after reserve(). Threads: one.
class PressedTurning {
 public:
  /// `mesh` must have passed check().
  explicit PressedTurning(const SpringMesh& mesh) : springs_(mesh) {}

  /// Room for this many loads.
  void reserve(std::size_t loads);

  /// T begins at zero again.
  void rest() noexcept { springs_.rest(); }

  struct Found {
    bool known = false;  ///< finite, and the constraints' changes have settled
    Eigen::Matrix3d stiffness_W_Nm_per_rad = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d gradient_W_N = Eigen::Matrix3d::Zero();  ///< d(torque)/dP
    int iterations = 0;                                      ///< conjugate-gradient iterations
  };
  /// @param lead   the springs in equilibrium under `loads`.
  /// @param tool_place  [m] P, from the springs' origin.
  /// @param stiffness_N_per_m  a scale of dF/dP.
  Found solve(const PressedSprings& lead, const std::vector<PointLoad>& loads,
              const Eigen::Vector3d& tool_place, double stiffness_N_per_m,
              int max_iterations) noexcept;

 private:
  Eigen::Vector3d place(const PointLoad& load) const noexcept;
  /// How far a point stays behind what the tool does there.
  static Eigen::Matrix3d lag(const PointLoad& load, const PressedSprings& springs) noexcept;
  /// Adds to each L_p what its constraint still gives. @returns the largest, over its stiffness.
  double substitute() noexcept;

  PressedSprings springs_;
  std::vector<PointLoad> loads_;
};

}  // namespace forcegrid::simulator
