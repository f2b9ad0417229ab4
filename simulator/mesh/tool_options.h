// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::simulator {

/// The tool and its kind of contact; names as on the command line.
struct ToolOptions {
  std::string shape = "point";     ///< or sphere, capsule, grasper, blade
  std::string contact = "sticky";  ///< or slide
  double radius_m = 0.008;         ///< of all but a point, see contact::ToolShape
  double length_m = 0.04;          ///< of a capsule, a blade and of a grasper's jaws
  double opening_rad = 0.7;        ///< between a grasper's jaws
  double friction = 0.3;           ///< mu of a sliding contact, 0 to kMaxFriction
  double grasp_N = 0.3;            ///< [N] a grasper closes when pressed with this force; > 0
  double let_go_N = 1.0;           ///< [N] a grasper opens when pulled with this force; > 0
  bool turns = false;              ///< with the hand, about its tip; else it stays upright

  static constexpr double kMaxFriction = 2.0;

  bool slides() const { return contact == "slide"; }
  /// The default tool of a scene.
  bool is_sticky_point() const { return shape == "point" && !slides() && !turns; }
  bool has_length() const { return shape == "capsule" || shape == "grasper" || shape == "blade"; }
  /// Its force is a function of its position alone.
  bool needs_position_alone() const { return !slides() && !turns; }
};

/// Throws Error naming options that exclude each other: a point that slides, a grasper that sticks.
void check_together(const ToolOptions& options);

}  // namespace forcegrid::simulator
