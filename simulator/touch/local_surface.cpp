// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/local_surface.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "contact/distance.h"
#include "rt/vectors.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {
namespace {

constexpr double kFirstLook_m = 0.004;
constexpr double kLastLook_m = 0.1;

// A patch tells of an upright rod or two.
bool can_be_told(const ToolOptions& tool) {
  return tool.shape == "point" || (tool.shape != "blade" && !tool.turns);
}

contact::ToolShape smallest_sphere() {
  return contact::ToolShape::sphere(contact::ToolShape::kMinRadius_m);
}

}  // namespace

std::optional<LocalSurface> LocalSurface::make(const SpringMesh& mesh, const ToolOptions& tool) {
  if (mesh.triangles.empty() || !can_be_told(tool)) {
    return std::nullopt;
  }
  return LocalSurface(mesh, tool, tool_shape(tool).value_or(smallest_sphere()));
}

LocalSurface::LocalSurface(const SpringMesh& mesh, const ToolOptions& tool,
                           const contact::ToolShape& shape)
    : tree_(mesh.triangles, mesh.rest_position_W),
      shape_(shape),
      tool_radius_m_(tool.shape == "point" ? 0.0F : static_cast<float>(tool.radius_m)),
      tool_length_m_(tool.has_length() ? static_cast<float>(tool.length_m) : 0.0F),
      tool_opening_crad_(static_cast<std::uint8_t>(std::lround(100.0 * shape.opening_rad()))) {}

void LocalSurface::cut(const std::optional<Eigen::Vector3d>& touch_W, link::SurfacePatch& patch) {
  patch.tool_radius_m = tool_radius_m_;
  patch.tool_length_m = tool_length_m_;
  patch.tool_opening_crad = tool_opening_crad_;
  const Eigen::Vector3d position_W = rt::to_vector(patch.position_W_m);
  const auto near = tree_.nearest(shape_, touch_W.value_or(position_W), kReach_m);
  if (!near) {
    return;
  }
  find_nearest(near->touch.point_W);
  vertices_.clear();
  for (const auto& [distance_m, triangle] : nearest_) {
    add(triangle, position_W, patch);
  }
}

void LocalSurface::find_nearest(const Eigen::Vector3d& point_W) {
  for (double look_m = kFirstLook_m; look_m < kLastLook_m; look_m *= 2.0) {
    nearest_.clear();
    tree_.visit_near(smallest_sphere(), point_W, look_m, [&](std::int32_t triangle) {
      const contact::Corners corners_W = tree_.corners_W(static_cast<std::size_t>(triangle));
      const Eigen::Vector3d weights = contact::nearest_weights(point_W, corners_W);
      const Eigen::Vector3d there_W =
          weights[0] * corners_W[0] + weights[1] * corners_W[1] + weights[2] * corners_W[2];
      nearest_.emplace_back((there_W - point_W).norm(), triangle);
    });
    // The search finds every triangle within look_m, but not all beyond it.
    std::ranges::sort(nearest_);
    if (nearest_.size() >= link::SurfacePatch::kMaxTriangles &&
        nearest_[link::SurfacePatch::kMaxTriangles - 1].first <= look_m) {
      return;
    }
  }
}

// Leaves out a triangle that the patch has no room for.
void LocalSurface::add(std::int32_t triangle, const Eigen::Vector3d& position_W,
                       link::SurfacePatch& patch) {
  if (patch.triangle_count == link::SurfacePatch::kMaxTriangles) {
    return;
  }
  const contact::SurfaceTree::Triangle& corners =
      tree_.triangle(static_cast<std::size_t>(triangle));
  const contact::Corners corners_W = tree_.corners_W(static_cast<std::size_t>(triangle));
  const std::size_t known = vertices_.size();
  link::SurfacePatch::Triangle numbers{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto found = std::ranges::find(vertices_, corners[k]);
    numbers[k] = static_cast<std::uint8_t>(found - vertices_.begin());
    const Eigen::Vector3d offset_W = corners_W[k] - position_W;
    if (found != vertices_.end()) {
      continue;
    }
    if (vertices_.size() == link::SurfacePatch::kMaxVertices ||
        offset_W.cwiseAbs().maxCoeff() > link::SurfacePatch::kMaxOffset_m) {
      for (std::size_t v = known; v < vertices_.size(); ++v) {
        patch.vertices_W_m[v] = {};
      }
      vertices_.resize(known);
      return;
    }
    vertices_.push_back(corners[k]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      patch.vertices_W_m[numbers[k]][axis] =
          static_cast<float>(offset_W[static_cast<Eigen::Index>(axis)]);
    }
  }
  patch.triangles[patch.triangle_count++] = numbers;
  patch.vertex_count = static_cast<std::uint8_t>(vertices_.size());
}

}  // namespace forcegrid::simulator
