// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "link/messages.h"

namespace forcegrid::link {

/// Simulator -> servo, optional, beside its samples: the part of the surface that a tool in the air
/// may touch next, so that the servo need not wait for a sample to detect the touch.
struct SurfacePatch {
  static constexpr std::size_t kMaxVertices = 19;  ///< two rings around a vertex of a regular mesh
  static constexpr std::size_t kMaxTriangles = 27;
  static constexpr double kMaxOffset_m = 1.0;  ///< of a vertex from the tool, along each axis
  static constexpr float kMaxToolRadius_m = 0.1F;
  static constexpr float kMaxToolLength_m = 0.5F;
  static constexpr std::uint8_t kMaxToolOpening_crad = 160;
  static constexpr double kPressDepth_m = 1e-3;
  static constexpr std::size_t kPresses = 2;

  using Vertex = std::array<float, 3>;
  using Triangle = std::array<std::uint8_t, 3>;

  std::uint32_t sequence = 0;           ///< the simulator's own count of patches
  std::uint32_t echo_sequence = 0;      ///< ToolState::sequence for which it was made
  std::int64_t echo_servo_time_ns = 0;  ///< ToolState::servo_time_ns of that message
  std::uint32_t contact_epoch = 0;      ///< of the air: it ends where the next contact begins
  bool has_stiffness = false;
  bool has_press_forces = false;  ///< not both: a tool sticks or slides
  std::uint8_t vertex_count = 0;
  std::uint8_t triangle_count = 0;  ///< 0: nothing is near
  /// The simulator's tool: an upright rod with round ends on its tip, the position of tool states;
  /// a sphere without length, a point without radius.
  float tool_radius_m = 0.0F;
  float tool_length_m = 0.0F;
  /// [0.01 rad] Above 0 the tool is a grasper: two such rods that meet in a hinge above its tip and
  /// open by this angle in W's x-z plane, as contact::ToolShape::grasper().
  std::uint8_t tool_opening_crad = 0;
  /// dF/dP, which is symmetric, of a tool that has just touched here: xx, yy, zz, xy, xz, yz. Zero
  /// unless has_stiffness.
  std::array<float, 6> stiffness_W_N_per_m{};
  /// For a tool that presses and slides, whose stiffness starts at zero: the force on it once it
  /// has touched here and moved straight on until it is 1 and 2 kPressDepth_m deep, measured along
  /// the outward normal where it touched. Zero unless has_press_forces.
  std::array<std::array<float, 3>, kPresses> press_forces_W_N{};
  Vector3 position_W_m{};  ///< of that tool state
  /// From position_W_m, along W's axes; those beyond vertex_count are zero.
  std::array<Vertex, kMaxVertices> vertices_W_m{};
  /// Vertex numbers, counterclockwise seen from outside; zero beyond triangle_count.
  std::array<Triangle, kMaxTriangles> triangles{};
};

}  // namespace forcegrid::link
