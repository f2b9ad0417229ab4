// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// Finds where a tool's path crosses an object's surface at rest. Real-time: after construction no
/// allocation, lock or throw. Threads: any, const.
class WayIn {
 public:
  /// @param shape  nothing: a point.
  WayIn(const SpringMesh& mesh, const std::optional<contact::ToolShape>& shape);

  /// [m] The tool's position where it first touches on the straight line between two positions, of
  /// which the first is outside; within kTouching_m of the surface for a tool with a shape.
  std::optional<Eigen::Vector3d> between(const Eigen::Vector3d& from_W,
                                         const Eigen::Vector3d& to_W) const noexcept;

  /// Of the tool, from now on; see ToolShape::set_orientation().
  void turn_to(const Eigen::Quaterniond& orientation_WT) noexcept {
    if (shape_) {
      shape_->set_orientation(orientation_WT);
    }
  }

  static constexpr double kTouching_m = 1e-6;

 private:
  RestSurface surface_;
  std::optional<contact::ToolShape> shape_;
  std::optional<contact::SurfaceTree> tree_;  ///< with a shape
};

}  // namespace forcegrid::simulator
