// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct DynamicOptions {
  double step_s = 2e-3;      ///< longest time step h; > 0
  double max_move_m = 1e-3;  ///< longest move of the tool in one step; > 0
  /// Most steps of one advance, >= 1. A longer time is covered in longer steps, which are as stable
  /// and damp more; Equilibrium::reached stays true and long_step() returns true.
  int max_steps = 64;
  /// A step is solved when the linear system's residual is at most this times
  /// max(|F|, force_floor_N); > 0.
  double relative_tolerance = 1e-4;
  double force_floor_N = 0.05;  ///< > 0
  int max_iterations = 200;     ///< conjugate-gradient iterations of one step; >= 1
};

/// An elastic object with inertia and dampers, and a tool that may hold a patch of it. Computes
/// the next state and the force on the tool with linearly implicit (semi-implicit) Euler, one
/// Newton step per time step h:
///
///   (M + h D + h^2 K) v1 = M v0 + h f(x0),   x1 = x0 + h v1,   D = sum of k tau u u^T + drag
///
/// with f the springs', home springs' and loads' forces, K their Hessian, in which a compressed
/// spring's geometric part (f/l)(I - u u^T) is left out, so that the matrix is definite, and u the
/// springs' directions at x0. The change of u with the step in the dampers' forces is left out.
/// Finite elements add their exact K, and tau K to D. Where the matrix is then indefinite, the step
/// is taken in two halves (Equilibrium::halvings), and these again, up to six times.
/// Held and fixed vertices' v1 is prescribed: a held one keeps the place relative to the tool that
/// it had at the grab, and the tool goes straight on at constant speed. Solved by conjugate
/// gradients, matrix-free, preconditioned with the vertices' 3 x 3 blocks.
///
/// The force on the tool is the sum over the held vertices of springs, dampers, home springs and
/// loads in the state at the end. The held vertices' own inertia is not in it: their acceleration
/// would be the second difference of positions known in encoder counts.
///
/// The method is of first order and unconditionally stable. It adds damping equivalent to a
/// retardation time of about h. Positions, velocities and residuals are in double precision.
/// Source: Baraff and Witkin, Large steps in cloth simulation, SIGGRAPH 1998, section 3; the
/// definite Hessian after Choi and Ko, Stable but responsive cloth, SIGGRAPH 2002.
///
/// Real-time: no allocation after construction except in grab(); bounded by DynamicOptions.
/// Threads: one object belongs to one thread at a time.
class DynamicObject {
 public:
  /// Throws Error for a mesh that check() refuses or that has no masses, and for options out of
  /// range.
  explicit DynamicObject(const SpringMesh& mesh, const DynamicOptions& options = {});
  ~DynamicObject();
  DynamicObject(DynamicObject&&) noexcept;
  DynamicObject& operator=(DynamicObject&&) noexcept;

  std::size_t vertex_count() const noexcept;
  std::size_t spring_count() const noexcept;
  const DynamicOptions& options() const noexcept;

  /// The free vertices that are now within `radius_m` of `point_W` [m] move rigidly with the tool
  /// from now on.
  /// @returns how many; 0 when none is near: then nothing has changed.
  /// Throws Error when a patch is held already.
  int grab(const Eigen::Vector3d& point_W, double radius_m);

  /// Releases the patch; the object moves on from its present state.
  void release() noexcept;

  /// Releases the patch and puts the object at rest in its rest pose.
  void rest() noexcept;

  bool grabbed() const noexcept;

  /// Advances the object by `duration_s`, during which the tool moves straight to `displacement_W`
  /// [m] from where it grabbed. Without a grab the displacement is not used. For 0 s nothing moves,
  /// and a displacement other than the last one gives reached = false. A duration that is negative
  /// or not finite, or a displacement that is not finite, gives reached = converged = false.
  /// @returns force_W = raw_force_W; relative_residual, of the worst step, is |A v1 - b| / h over
  ///   max(|F|, force_floor_N); converged: all steps within the tolerance and everything finite;
  ///   iterations, evaluations and steps of all steps together. stiffness_W is zero: force depends
  ///   on the past, not on the position alone.
  Equilibrium advance(double duration_s, const Eigen::Vector3d& displacement_W) noexcept;

  /// [s] Length of the steps of the last advance.
  double last_step_s() const noexcept;
  /// The last advance took longer steps than DynamicOptions::step_s.
  bool long_step() const noexcept;

  /// [m], [m/s] All vertices' in W, in the mesh's numbering.
  std::vector<Eigen::Vector3d> positions_W() const;
  std::vector<Eigen::Vector3d> velocities_W() const;
  /// Copies where `vertices` (the mesh's numbering) stand now, [m] in W, into `position_W`, which
  /// gets their number. Allocates only to grow it.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace forcegrid::simulator
