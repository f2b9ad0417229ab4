// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/neighbourhood.h"

namespace forcegrid::simulator {

/// Tolerances and limits of the solver for one answer.
struct SolverOptions {
  /// A state is an equilibrium when Equilibrium::relative_residual is at most this; > 0.
  double relative_tolerance = 1e-3;
  /// [N] The residual is compared with the force, but with no less than this: near the rest pose
  /// the force vanishes and single precision leaves about 1e-6 N.
  double force_floor_N = 0.05;
  /// [m] A longer move is made in equal steps of at most this; > 0. Keeps the state on its branch.
  double max_step_m = 2e-3;
  /// A move of up to three times max_step_m is tried in one step first. It is divided if the
  /// prediction leaves a larger residual, |r| / max(|F|, force_floor_N), than this. 0: always
  /// divided.
  double long_step_residual = 0.05;
  /// Most steps of a move; a move that needs more ends part of the way (Equilibrium::reached).
  int max_steps = 24;
  /// Most conjugate-gradient iterations of each step but the last, which iterates to the tolerance.
  /// A step ends earlier when |r| is at 1e-2 of the force.
  int iterations_per_step = 3;
  /// Most conjugate-gradient iterations of the last step, over all corrections.
  int max_iterations = 240;
  /// Most descents in energy of one answer after its state became unstable (a deep push snaps
  /// through). Each takes about 20 ms on a block of 10,000 vertices; the next answer continues.
  int max_recovery_steps = 24;
  /// If the prediction's residual |r| / |F| is below this, the answer is returned first and
  /// conjugate gradients correct the state afterwards, for the next move: one evaluation instead of
  /// two. 0: always correct first. For servo rates, where the prediction is good.
  double answer_first_below = 0.0;
  /// Above 0: solve only the region that the tool disturbs, whole rings of neighbours around the
  /// patch. The region grows until the work residual on its border, the sum of |S_i^T r_i| over the
  /// ring outside, is at most this fraction of |F|, and shrinks when it is far below. The rest of
  /// the object follows S. 0: solve the whole object.
  double border_tolerance = 0.0;
  /// With border_tolerance: solve at most this many vertices, even if the border residual is larger
  /// than allowed, so that the cost does not grow with the object. For TwoRatesObject, which
  /// corrects the object outside the region. 0: no limit.
  int most_vertices = 0;
  /// Largest |(K S)_f| / (K S at the patch) to accept after a move, for the predictor of the next.
  double sensitivity_tolerance = 0.05;
};

/// The state at one tool position and how good it is.
struct Equilibrium {
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();  ///< [m] of the tool since the grab
  /// [N] of the object on the tool, F = sum over patch and free vertices of S_i^T r_i: the raw sum
  /// over the patch, corrected by the work of the remaining residual. Second order in the error.
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
  Eigen::Vector3d raw_force_W = Eigen::Vector3d::Zero();  ///< [N] sum over the patch alone
  Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();  ///< [N/m] J = dF/dP = -S^T K S
  /// |r| / max(|F|, force_floor_N): r the springs' forces on all free vertices as one vector,
  /// Euclidean norm; F = force_W.
  double relative_residual = 0.0;
  double sensitivity_residual = 0.0;  ///< the same of K S, see SolverOptions
  double force_gap_N = 0.0;           ///< |force_W - raw_force_W|: bounds the force's error in use
  int steps = 0;                      ///< moves of at most max_step_m
  int evaluations = 0;                ///< evaluations of all springs
  int iterations = 0;                 ///< conjugate-gradient iterations
  int halvings = 0;                   ///< steps repeated at half length (unstable or not finite)
  int vertices = 0;                   ///< vertices in the last evaluation
  /// [N] Sum of |S_i^T r_i| over the ring around the region, see SolverOptions::border_tolerance; 0
  /// when the whole object is solved.
  double border_work_N = 0.0;
  /// Of an object that was told to turn(), and of a PressedObject: the torque is known.
  bool torque_known = false;
  Eigen::Quaterniond turn_W = Eigen::Quaterniond::Identity();  ///< of the tool since the grab
  /// [N m] Of the object on the tool about its position, sum over patch and free vertices of
  /// T_i^T r_i: second order in the error, as the force.
  Eigen::Vector3d torque_W_Nm = Eigen::Vector3d::Zero();
  bool rotational_stiffness_known = false;  ///< else the following is zero
  /// d(torque)/d(theta) at a fixed position; theta is the rotation vector by which the tool turns
  /// on. Not symmetric: sum over the patch of (theta x l) x f is part of it.
  Eigen::Matrix3d rotational_stiffness_W_Nm_per_rad = Eigen::Matrix3d::Zero();
  /// d(torque)/dP [N] at a fixed orientation, known with the above: -T^T K S. Without friction its
  /// transpose is d(force)/d(theta).
  Eigen::Matrix3d torque_gradient_W_N = Eigen::Matrix3d::Zero();
  double solve_time_s = 0.0;  ///< wall time of the move
  bool reached = true;        ///< the tool reached its target; false: see displacement_W
  bool converged = false;     ///< relative_residual <= relative_tolerance and everything is finite
  /// The object left its branch of equilibria: it became unstable and moved to another one. Force
  /// and stiffness jumped since the last answer.
  bool left_branch = false;
};

/// A mass-spring object under a tool that holds a patch of it: quasi-static equilibria and the
/// force on the tool, warm started along the tool's path.
///
/// Energy E(x; P) = sum of the springs'; the patch follows the tool rigidly, x_g = X_g + P, fixed
/// vertices stay, and the free ones solve r = -dE/dx_f = 0. Beside the positions x the solver
/// carries the sensitivities S = dx/dP (K_ff S = -K_fg 1; three more right-hand sides of the same
/// matrix, in SIMD lanes). They give the predictor x += S dP, a force of second-order accuracy and
/// the stiffness J. Each step: predict, one pass of evaluation, block-Jacobi preconditioned
/// conjugate gradients with a step length a lane.
///
/// A tool that turns holds its patch by x_g = P + R (X_g - P_0), R from the grab on. turn() makes
/// the solver carry the sensitivities T = dx/d(theta), too, with T_g = -[x_g - P]x on the patch.
/// They give the predictor of a turn and the torque. The equations for x, S and the force are the
/// same, and so is every digit of the force of a tool that has not turned.
///
/// Real is the precision of positions, forces and residual: float for the 30 Hz simulator (residual
/// down to about 1e-5 of a newton), double for the reference force. Corrections and S are single
/// precision in both; in double, repeated corrections still converge to double's accuracy.
///
/// Real-time: no allocation after construction except in grab(); bounded by SolverOptions.
/// Threads: one object belongs to one thread at a time; different objects are independent.
template <typename Real>
class ElasticObject {
 public:
  /// Throws Error for a mesh that check() refuses or options out of range.
  explicit ElasticObject(const SpringMesh& mesh, const SolverOptions& options = {});
  ~ElasticObject();
  ElasticObject(ElasticObject&&) noexcept;
  ElasticObject& operator=(ElasticObject&&) noexcept;

  std::size_t vertex_count() const noexcept;
  std::size_t spring_count() const noexcept;
  std::size_t memory_bytes() const noexcept;  ///< that it holds, itself included
  const SolverOptions& options() const noexcept;

  /// Changes SolverOptions::relative_tolerance from the next move on. Throws Error unless > 0.
  void set_relative_tolerance(double relative_tolerance);

  /// From the next grab on the tool may turn, and answers have a torque. An answer then costs about
  /// twice as much. Allocates. Throws Error with a border_tolerance: the whole object is solved.
  /// @param mesh  that of the constructor.
  void turn(const SpringMesh& mesh);
  bool turns() const noexcept;

  /// Number of vertices that grab(point_W, radius_m) would hold.
  int count_grabbable(const Eigen::Vector3d& point_W, double radius_m) const noexcept;

  /// From the rest pose: the free vertices within `radius_m` of `point_W` [m] move rigidly with the
  /// tool from now on. Solves for S.
  /// @returns how many vertices are held; 0 when none is near: then nothing has changed.
  /// Throws Error when a patch is held already.
  int grab(const Eigen::Vector3d& point_W, double radius_m);

  /// Releases the patch; the object returns to its rest pose.
  void release() noexcept;

  bool grabbed() const noexcept;

  /// Moves the tool to `displacement_W` [m] from where it grabbed, in W, and solves for the
  /// equilibrium. Without a grab nothing moves and the force is zero. A displacement that is not
  /// finite changes nothing and returns the last force with converged = reached = false.
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept;
  /// The same with the tool turned by `turn_W`, a unit quaternion, since the grab about its
  /// position. One that is not finite is as such a displacement. Only of an object that turns().
  Equilibrium move_to(const Eigen::Vector3d& displacement_W,
                      const Eigen::Quaterniond& turn_W) noexcept;

  /// The vertices, in the mesh's numbering, whole rings around the patch, that a region of at most
  /// SolverOptions::most_vertices goes through. Allocates.
  std::vector<std::int32_t> neighbourhood() const;

  /// Where these vertices (the mesh's numbering) stand now; `copy` must have as many.
  void copy(const std::vector<std::int32_t>& vertices, Neighbourhood& copy) const noexcept;

  /// Corrects the present state by what another object found: `was` and `is` are copies of
  /// neighbourhood() of this object and of the other one, with the tool at the same place P_o. With
  /// the tool now at P,
  ///   S += S_is - S_was,   x += x_is - x_was + (S_is - S_was) (P - P_o)
  /// and the next move starts from there.
  void correct(const Neighbourhood& was, const Neighbourhood& is) noexcept;

  /// [m] All vertices' positions in W, in the mesh's numbering.
  std::vector<Eigen::Vector3d> positions_W() const;
  /// Copies where `vertices` (the mesh's numbering) stand now, [m] in W, into `position_W`, which
  /// gets their number. With border_tolerance the vertices outside the region follow S. Allocates
  /// only to grow it.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const;

  /// Vertices that the tool holds, in the mesh's numbering.
  const std::vector<std::int32_t>& patch() const noexcept;

  /// S of one vertex: row c, column j is dx_c / dP_j.
  Eigen::Matrix3d sensitivity(std::size_t vertex) const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

extern template class ElasticObject<float>;
extern template class ElasticObject<double>;

}  // namespace forcegrid::simulator
