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

/// Cuts out of an object's surface at rest what a tool in the air may touch next, for the servo to
/// look at in each of its cycles: as many of the nearest triangles as a link::SurfacePatch holds.
///
/// Real-time: no (allocates). Threads: one.
class LocalSurface {
 public:
  /// [m] A surface farther away than this is not near.
  static constexpr double kReach_m = 0.02;

  /// Nothing for an object without triangles. A grasper's opening is stated to 0.01 rad.
  static std::optional<LocalSurface> make(const SpringMesh& mesh, const ToolOptions& tool);

  /// Fills in tool, vertices and triangles; none of these where nothing is near.
  /// @param patch  position_W_m says where the tool is.
  /// @param touch_W  [m] where the tool will be when it touches, as far as that can be foretold.
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
  std::vector<std::pair<double, std::int32_t>> nearest_;  // [m] from where it was cut, triangle
  std::vector<std::int32_t> vertices_;                    // of the mesh, by those of the patch
};

}  // namespace forcegrid::simulator
