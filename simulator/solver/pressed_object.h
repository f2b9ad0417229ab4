// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <vector>

#include "contact/tool_shape.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct PressOptions {
  double friction = 0.3;  ///< Coulomb's mu between tool and surface, 0 to 2
  /// [m] How far a point gives sideways before it slips; > 0.
  double stick_m = 1e-4;
  /// [m] Largest distance between the points at which the tool presses; 0: a quarter of the tool's
  /// radius, at which a sphere sinks in between them by a hundredth of its radius.
  double point_spacing_m = 0.0;
  /// A state is an equilibrium when the residual, the force gap and the contact forces' remaining
  /// change are at most this times max(|F|, force_floor_N); > 0.
  double relative_tolerance = 2e-3;
  double force_floor_N = 0.05;
  /// [m] A longer move is made in equal steps of at most this, and of half the tool's radius; > 0.
  double max_step_m = 2e-3;
  int max_steps = 12;        ///< with contact; a longer move ends part of the way
  int max_rounds = 40;       ///< of one step: Newton steps and corrections of the contact forces
  int max_iterations = 400;  ///< conjugate-gradient iterations of one step
  /// Answers have d(torque)/d(theta), too (PressedTurning); costs up to a dozen more solutions.
  bool rotational_stiffness = false;
};

/// The state at one tool position.
struct Pressed {
  /// As an ElasticObject's answer; displacement_W is not used. force_W and raw_force_W are both
  /// minus the sum of the tool's forces on the surface, so that they keep friction's bound; the
  /// torque is minus that of the same forces. Its derivative is known as PressOptions says, unless
  /// a point slips with friction. force_gap_N is |sum S_i^T r_i|, the error that the residual may
  /// cause in them.
  Equilibrium equilibrium;
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m] of the tool
  int points = 0;                                        ///< that bear force
  int slipping = 0;                                      ///< of them
  int held = 0;                                          ///< between closed jaws
  double normal_N = 0.0;  ///< sum over the points of their normal forces
  Eigen::Vector3d friction_W = Eigen::Vector3d::Zero();  ///< [N] sum of friction, on the tool
  /// [m] Mean of the points' places, weighted with their forces; the tool's position without any.
  Eigen::Vector3d centre_W = Eigen::Vector3d::Zero();
  double deepest_m = 0.0;  ///< largest depth that a bearing point still has inside the tool
  /// Of the tool, for which everything else was computed.
  Eigen::Quaterniond orientation_WT = Eigen::Quaterniond::Identity();
  /// stiffness_W is dF/dP: true unless a point slips with friction.
  bool stiffness_known = true;
};

/// A mass-spring object that a rigid tool presses, slides over and may grasp: quasi-static
/// equilibria along the tool's path. The tool may turn about its position.
///
///   r_i = -dE/dx_i + sum_p w_ip R_p(x_p, P) = 0 on all free vertices,  F = -sum_p R_p
///
/// over material points p of the surface (x_p = sum_i w_ip x_i, see SurfacePoints) near the tool,
/// with R_p from react(): no point stays inside the tool, none is pulled, and friction is
/// Coulomb's. For each step of the tool, Newton steps with four right-hand sides (the residual and
/// the sensitivities S = dx/dP, as ElasticObject's) and substitutions of the contact forces repeat
/// until both have settled. Points come and go with zero force, so that the force is continuous,
/// also where contact is made or broken. When no point bears force any more, the object is at rest.
///
/// Friction makes the force depend on the path. Threads: one.
/// Real-time: no allocation after construction; bounded by PressOptions.
class PressedObject {
 public:
  /// Throws Error for a mesh that check() refuses, one without triangles, or options out of range.
  PressedObject(const SpringMesh& mesh, const contact::ToolShape& tool,
                const PressOptions& options = {});
  ~PressedObject();
  PressedObject(PressedObject&&) noexcept;
  PressedObject& operator=(PressedObject&&) noexcept;

  std::size_t vertex_count() const noexcept;
  std::size_t spring_count() const noexcept;
  const contact::ToolShape& tool() const noexcept;

  /// Puts the object at rest and the tool at `position_W` [m], from where it moves on.
  void reset(const Eigen::Vector3d& position_W) noexcept;
  /// The same with the tool turned.
  void reset(const Eigen::Vector3d& position_W, const Eigen::Quaterniond& orientation_WT) noexcept;

  /// [m] From the tool at `position_W` to the surface in its present shape, at most `margin_m`.
  double gap_m(const Eigen::Vector3d& position_W, double margin_m) const noexcept;

  /// Moves the tool straight on to `position_W` [m]. A position that is not finite changes nothing
  /// and gives the last state with converged = reached = false.
  Pressed move_to(const Eigen::Vector3d& position_W) noexcept;
  /// The same, and turns the tool on to `orientation_WT`, a unit quaternion, the shorter way and
  /// evenly on that line. One that is not finite is as such a position.
  Pressed move_to(const Eigen::Vector3d& position_W,
                  const Eigen::Quaterniond& orientation_WT) noexcept;

  /// Closes a grasper's jaws: the points of the surface between them, in its present shape, move
  /// with the tool from now on. The force is continuous.
  /// @returns how many; 0 when there is nothing between them, or for another tool.
  int grasp() noexcept;

  /// Opens the jaws again: what they held is free, and only pressed on.
  void let_go() noexcept;

  /// [m] All vertices' positions in W, in the mesh's numbering.
  std::vector<Eigen::Vector3d> positions_W() const;
  /// Copies where `vertices` (the mesh's numbering) stand now, [m] in W, into `position_W`, which
  /// gets their number. Allocates only to grow it.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace forcegrid::simulator
