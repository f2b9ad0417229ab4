// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "link/surface_patch.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::simulator {

/// Extracts the part of an object's surface at rest that a tool may touch next: the nearest
/// triangles, as many as a link::SurfacePatch holds. The servo tests the tool against them in every
/// cycle.
///
/// Real-time: no (allocates). Threads: one.
class LocalSurface {
 public:
  /// [m] Surfaces farther away than this are left out.
  static constexpr double kReach_m = 0.02;

  /// Nothing for an object without triangles. A grasper's opening is stated to 0.01 rad.
  static std::optional<LocalSurface> make(const SpringMesh& mesh, const ToolOptions& tool);

  /// Fills in the tool and the nearest vertices and triangles, none if no surface is within
  /// kReach_m.
  /// @param touch_W  [m] the tool's position at the predicted touch; nothing: its present one is
  ///   used.
  /// @param patch  its position_W_m is the tool's present position.
  void cut(const std::optional<Eigen::Vector3d>& touch_W, link::SurfacePatch& patch);

 private:
  LocalSurface(const SpringMesh& mesh, const ToolOptions& tool, const contact::ToolShape& shape);

  void find_nearest(const Eigen::Vector3d& point_W);
  void add(std::int32_t triangle, const Eigen::Vector3d& position_W, link::SurfacePatch& patch);

  contact::SurfaceTree tree_;
  contact::ToolShape shape_;
  float tool_radius_m_;
  float tool_length_m_;
  std::uint8_t tool_opening_crad_;
  std::vector<std::pair<double, std::int32_t>> nearest_;  // distance [m] and triangle
  std::vector<std::int32_t> vertices_;  // the mesh's number of each vertex of the patch
};

}  // namespace forcegrid::simulator
