// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

/// An elastic object that several tools hold at once: quasi-static equilibria and the force on each
/// tool.
///
/// Tool k holds the patch G_k, which follows it rigidly from where it stood at the grab, x_g = A_g
/// + P_k. The free vertices solve r = -dE/dx_f = 0 under all tools at once. There is one state x,
/// and for each tool the sensitivities S_k = dx/dP_k, which are the identity on G_k and zero where
/// another tool holds. They give
///
///   x += sum_k S_k dP_k                 the predictor of a move of all tools together
///   F_k = sum_i S_k,i^T r_i             [N] on tool k, second order in the error as for one tool
///   J_k = dF_k/dP_k = -S_k^T K S_k      [N/m] with the other tools where they are
///   J_kj = dF_k/dP_j = -S_k^T K S_j     [N/m] of tool j's position; J_jk is its transpose
///
/// Where shorter steps do not get past an unstable state, the object begins anew at rest and the
/// tools come from where they grabbed, in one solve(): the equilibria that begin at rest are those
/// that reference forces are of. If that meets one, too, it goes downhill in energy to another
/// branch. Equilibrium::left_branch tells of both. Near such states S is large: the predictor moves
/// no vertex further than 3 times the tools' way.
///
/// Each tool's S is carried by a StateWithSensitivities of its own, whose positions are kept equal.
/// So an answer costs about as many times that of ElasticObject as tools hold the object. With one
/// tool the equations are those of ElasticObject.
///
/// After turn() tools may turn about their positions, as ElasticObject documents: each has T_k =
/// dx/d(theta_k), which is zero where another tool holds, and a torque T_k^T r about P_k.
///
/// Real-time: no allocation after construction except in grab() and release(); bounded by
/// SolverOptions. Threads: one.
template <typename Real>
class SharedObject {
 public:
  /// Throws Error for a mesh that check() refuses, options out of range or with a border_tolerance
  /// (the whole object is solved), and no tool.
  SharedObject(const SpringMesh& mesh, const SolverOptions& options, std::size_t tools);
  ~SharedObject();
  SharedObject(SharedObject&&) noexcept;
  SharedObject& operator=(SharedObject&&) noexcept;

  std::size_t vertex_count() const noexcept;
  std::size_t spring_count() const noexcept;
  std::size_t tool_count() const noexcept;

  /// From the next grab on the tools may turn, and their results have a torque. A solution then
  /// costs about twice as much. Allocates. Before any grab.
  /// @param mesh  that of the constructor.
  void turn(const SpringMesh& mesh);
  bool turns() const noexcept;

  /// The vertices that lie within `radius_m` of `point_W` [m] in the rest shape, and are neither
  /// fixed nor held, move rigidly with the tool from now on, from where they are. Solves for S.
  /// @returns how many vertices the tool holds; 0 when none is near: then nothing has changed.
  /// Throws Error when the tool holds a patch already.
  int grab(std::size_t tool, const Eigen::Vector3d& point_W, double radius_m);

  /// Releases the tool's patch. The object moves to its equilibrium under the other tools, or to
  /// rest without any.
  void release(std::size_t tool);

  bool grabbed(std::size_t tool) const noexcept;

  /// Where solve() moves the tool, [m] in W from where it grabbed. A displacement that is not
  /// finite changes nothing.
  void aim(std::size_t tool, const Eigen::Vector3d& displacement_W) noexcept;
  /// The same with the tool turned by `turn_W`, a unit quaternion, since it grabbed. Only of an
  /// object that turns().
  void aim(std::size_t tool, const Eigen::Vector3d& displacement_W,
           const Eigen::Quaterniond& turn_W) noexcept;

  /// Moves all tools to their aims at once and solves for the equilibrium.
  void solve() noexcept;

  /// The last result for this tool. Its residual, evaluations and iterations are those of the
  /// object under all tools; `reached` is false for all of them if the move was too long. Zero
  /// force without a grab.
  const Equilibrium& equilibrium(std::size_t tool) const noexcept;

  /// [N/m] dF_k/dP_j at the last result: how the force on `tool` changes with the position of
  /// `other`. Nothing unless both hold the object and the result has converged.
  std::optional<Eigen::Matrix3d> stiffness_W(std::size_t tool, std::size_t other) const noexcept;

  /// The vertices that the tool holds, in the mesh's numbering.
  const std::vector<std::int32_t>& patch(std::size_t tool) const noexcept;

  /// [m] Where these vertices are in W: copied to `position_W`, which gets their number.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const;
  /// [m] All vertices' positions in W, in the mesh's numbering.
  std::vector<Eigen::Vector3d> positions_W() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

extern template class SharedObject<float>;
extern template class SharedObject<double>;

}  // namespace forcegrid::simulator
