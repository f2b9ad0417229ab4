// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "contact/tool_shape.h"

namespace forcegrid::contact {

/// Corners of a triangle, counterclockwise seen from outside the object.
using Corners = std::array<Eigen::Vector3d, 3>;

/// Where a straight axis and a triangle come nearest to each other.
struct AxisToTriangle {
  double distance_m = 0.0;                                   ///< 0 where the axis goes through it
  Eigen::Vector3d on_axis = Eigen::Vector3d::Zero();         ///< [m]
  Eigen::Vector3d on_triangle = Eigen::Vector3d::Zero();     ///< [m] = sum of weights times corners
  Eigen::Vector3d weights = Eigen::Vector3d(1.0, 0.0, 0.0);  ///< barycentric, >= 0, sum 1
};

/// Point of the triangle that is nearest to `point`, both in one frame, as barycentric weights. A
/// triangle without area is taken as its edges.
/// Source: Ericson, Real-Time Collision Detection (2005), section 5.1.5.
/// Real-time: no allocation, lock or throw, as all functions here. Threads: any.
Eigen::Vector3d nearest_weights(const Eigen::Vector3d& point, const Corners& corners) noexcept;

/// The nearest points of the segment from `from` to `to` and a triangle. If several pairs are
/// equally near (a segment parallel to the triangle), one of them.
AxisToTriangle nearest(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                       const Corners& corners) noexcept;

/// Position of a tool relative to a triangle.
struct Touch {
  /// [m] Distance of a part's axis from the triangle minus the part's radius: positive outside,
  /// negative by the depth of penetration. At least -radius, since one triangle alone does not show
  /// on which side of it an axis is.
  double gap_m = 0.0;
  int part = 0;                                         ///< of ToolShape::parts()
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();    ///< [m] of the triangle
  Eigen::Vector3d on_tool_W = Eigen::Vector3d::Zero();  ///< [m] of the tool's surface
  Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< unit, from the triangle to the axis
  Eigen::Vector3d weights = Eigen::Vector3d(1.0, 0.0, 0.0);  ///< of point_W, barycentric
};

/// The nearest, or deepest, touch of any part of the tool at `position_W` [m] with a triangle.
/// Where an axis goes through the triangle the normal is the triangle's own.
Touch nearest(const ToolShape& tool, const Eigen::Vector3d& position_W,
              const Corners& corners_W) noexcept;

/// Position of one tool relative to another.
struct ToolToTool {
  /// [m] Between the surfaces of the two nearest parts, or by how much the deepest two overlap,
  /// negative. At least minus the sum of their radii.
  double gap_m = 0.0;
  /// Unit, from the second tool to the first one, along which the gap opens; zero where their axes
  /// meet, and nothing says which way that is.
  Eigen::Vector3d normal_W = Eigen::Vector3d::Zero();
};

/// The two tools at these positions [m]. The gap is a function of where one is relative to the
/// other, so that a force along the normal that depends on the gap alone has a potential.
ToolToTool nearest(const ToolShape& first, const Eigen::Vector3d& first_W, const ToolShape& second,
                   const Eigen::Vector3d& second_W) noexcept;

/// Position of a point relative to the tool at `position_W` [m].
struct PointInTool {
  double gap_m = 0.0;  ///< signed distance from the tool's surface, negative inside
  Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< unit, the gap's gradient: outward
  /// [1/m] The gap's second derivative, by which the normal turns; set to zero on an axis.
  Eigen::Matrix3d turning_W_per_m = Eigen::Matrix3d::Zero();
};

/// @param point_W  [m]. On an axis itself the normal is a fixed direction across it.
PointInTool locate(const ToolShape& tool, const Eigen::Vector3d& position_W,
                   const Eigen::Vector3d& point_W) noexcept;

/// Whether a point, from the tool's position along W's axes, lies between the jaws of a grasper or
/// in them: within a jaw's radius of the triangle of their tips and the hinge. Never for another
/// tool.
bool between_jaws(const ToolShape& tool, const Eigen::Vector3d& from_tool_W) noexcept;

}  // namespace forcegrid::contact
