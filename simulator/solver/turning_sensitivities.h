// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/state_with_sensitivities.h"

namespace forcegrid::simulator {

/// How the vertices of an object move when the tool that holds a patch of it turns: T =
/// dx/d(theta), theta the rotation vector in W, at a fixed position P of the tool.
///
///   T_g = -[x_g - P]x on the patch,  K_ff T_f = -K_fg T_g,
///   torque = sum_i T_i^T r_i = sum_g (x_g - P) x r_g in equilibrium,
///   d(torque)/d(theta) = -T^T K T + sum_g (l r_g^T - (l . r_g) 1),  l = x_g - P
///   d(torque)/dP       = -T^T K S
///
/// T_g does not depend on P, so the last line has no more terms. The last sum is that of (theta x
/// l) x r_g: the patch's forces keep their direction while their lever arms turn. The three
/// right-hand sides are solved in the lanes of a second StateWithSensitivities, whose positions are
/// copied from the first one's.
///
/// Real-time: no allocation after construction except in hold() and release(). Threads: one.
template <typename Real>
class TurningSensitivities {
 public:
  using State = StateWithSensitivities<Real>;

  /// `mesh` must have passed check().
  explicit TurningSensitivities(const SpringMesh& mesh) : state_(mesh) {}

  struct Found {
    bool known = false;  ///< finite, and T was solved for
    Eigen::Vector3d torque_W_Nm = Eigen::Vector3d::Zero();
    Eigen::Matrix3d stiffness_W_Nm_per_rad = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d gradient_W_N = Eigen::Matrix3d::Zero();  ///< d(torque)/dP
    int iterations = 0;                                      ///< conjugate-gradient iterations
  };

  /// `lead` has just taken hold of its patch, with the tool at `pivot` [m, from the origin].
  /// @param others  vertices that other tools hold (SharedObject), where T is zero.
  void hold(const State& lead, const Eigen::Vector3d& pivot,
            const std::vector<std::int32_t>& others = {});
  /// Other tools hold `others` from now on; T stays elsewhere. Allocates.
  void share(const State& lead, const std::vector<std::int32_t>& others);
  void release() noexcept;

  std::size_t memory_bytes() const noexcept;  ///< that it holds, itself included

  /// [m] The farthest that a vertex of the patch was from the tool's position at the grab.
  double reach_m() const noexcept { return reach_m_; }
  /// [m, from the origin] Where the patch stands without displacement, turned by `turn_W`.
  const std::vector<Eigen::Vector3d>& anchor(const Eigen::Quaterniond& turn_W) noexcept;

  /// Predicts a turn by `theta_W_rad`: adds T theta to the free vertices of `lead`.
  void predict(const Eigen::Vector3d& theta_W_rad, State& lead) const noexcept;

  /// Solves for T at the present state of `lead`, and for the torque.
  /// @param at  what lead's last evaluation has found.
  /// @param tolerance  of |K T|, relative to the stiffness times reach_m().
  Found solve(const State& lead, const Evaluation& at, double tolerance,
              int max_iterations) noexcept;

 private:
  void take_hold(const State& lead, const std::vector<std::int32_t>& others, bool anew);
  void follow(const State& lead, const Eigen::Vector3d& pivot) noexcept;

  State state_;
  Eigen::Vector3d pivot_ = Eigen::Vector3d::Zero();  ///< at the grab
  std::vector<std::int32_t> patch_;
  std::vector<Eigen::Vector3d> arm_;     ///< of each vertex of the patch from it, at the grab
  std::vector<Eigen::Vector3d> anchor_;  ///< scratch
  double reach_m_ = 0.0;
};

extern template class TurningSensitivities<float>;
extern template class TurningSensitivities<double>;

}  // namespace forcegrid::simulator
