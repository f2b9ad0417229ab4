// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "contact/tool_shape.h"

namespace forcegrid::simulator {

/// What is known about one surface point that may touch the tool. A force is known from the last
/// substitution, see react().
struct ContactPoint {
  double normal_N = 0.0;  ///< >= 0, the known normal force: the tool only pushes
  /// [m] In the tool's frame T: the place where the point sticks to the tool. Friction pulls it
  /// there.
  Eigen::Vector3d anchor_T = Eigen::Vector3d::Zero();
  bool touching = false;  ///< it touched in an earlier step of the tool, which set the anchor
  bool held = false;      ///< between closed jaws: it stays at its anchor at any force
  Eigen::Vector3d held_W = Eigen::Vector3d::Zero();  ///< [N] the known force of that
  /// [N/m] d(known forces)/dP.
  Eigen::Matrix3d pull_W = Eigen::Matrix3d::Zero();
};

/// How a tool's surface takes hold of a point.
struct ContactLaw {
  double friction = 0.0;   ///< Coulomb's mu >= 0
  double stick_m = 1e-4;   ///< how far a point gives sideways until it slips; > 0
  double e_N_per_m = 0.0;  ///< see react(); > 0
};

/// What the tool does to a point at its present place.
struct Reaction {
  enum class State { kOpen, kStick, kSlip, kHeld };
  State state = State::kOpen;
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();  ///< [N] on the point; zero when open
  /// [N/m] -d force_W / d point at the known normal force: symmetric.
  Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d convex_stiffness_W = Eigen::Matrix3d::Zero();  ///< without the turning normal
  /// The part of stiffness_W that only stands for a rigid constraint: e along the normal, or e in
  /// all directions for a held point.
  Eigen::Matrix3d rigid_stiffness_W = Eigen::Matrix3d::Zero();
  double gap_m = 0.0;                                  ///< signed, from the tool's surface
  Eigen::Vector3d normal_W = Eigen::Vector3d::Zero();  ///< unit, outward
  double normal_N = 0.0;                               ///< force_W along it
  Eigen::Vector3d anchor_T = Eigen::Vector3d::Zero();  ///< [m] moved along where the point slips
};

/// Unilateral contact with Coulomb's friction of one point:
///
///   R_n = max(0, N - e g),   R_t = -mu min(N, R_n) u / max(|u|, stick_m)
///
/// where N is the force that the point is known to bear, g the gap, and u the way along the tool's
/// surface from the point's anchor. Repeated substitution of R_n for N (an augmented Lagrangian)
/// leads to g >= 0, R_n >= 0, g R_n = 0 exactly; e only decides how fast. Friction yields by up to
/// stick_m before it slips, as a bristle does, so that it is a continuous function of the path.
/// |R_t| <= mu R_n always, and = mu R_n where the point slips and N is right. Source: Simo and
/// Laursen, An augmented Lagrangian treatment of contact problems involving friction, Computers &
/// Structures 42(1), 1992; Hayward and Armstrong, A new computational model of friction applied to
/// haptic rendering, 2000.
/// @param tool  turned as it is now: anchors are in its frame T.
/// @param position_W  [m] of the tool; point_W [m] in the same frame.
/// Real-time: no allocation, lock or throw. Threads: any.
Reaction react(const contact::ToolShape& tool, const Eigen::Vector3d& position_W,
               const Eigen::Vector3d& point_W, const ContactPoint& point,
               const ContactLaw& law) noexcept;

}  // namespace forcegrid::simulator
