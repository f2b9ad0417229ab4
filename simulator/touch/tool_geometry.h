#pragma once

#include <Eigen/Core>
#include <optional>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// Where a tool comes through an object's surface at rest. Real-time: after construction no
/// allocation, lock or throw. Threads: any, const.
class WayIn {
 public:
  /// @param shape  nothing: a point.
  WayIn(const SpringMesh& mesh, const std::optional<contact::ToolShape>& shape);

  /// The tool's position [m] where it first touches on the straight way between two positions, the
  /// first of them outside; within kTouching_m of the surface for a tool with a shape.
  std::optional<Eigen::Vector3d> between(const Eigen::Vector3d& from_W,
                                         const Eigen::Vector3d& to_W) const noexcept;

  static constexpr double kTouching_m = 1e-6;

 private:
  RestSurface surface_;
  std::optional<contact::ToolShape> shape_;
  std::optional<contact::SurfaceTree> tree_;  ///< with a shape
};

}  // namespace forcegrid::simulator
