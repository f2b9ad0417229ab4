// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/tool_geometry.h"

#include <algorithm>

namespace forcegrid::simulator {
namespace {

constexpr int kMaxTraces = 64;

}  // namespace

WayIn::WayIn(const SpringMesh& mesh, const std::optional<contact::ToolShape>& shape)
    : surface_(mesh), shape_(shape) {
  if (shape_) {
    tree_.emplace(mesh.triangles, mesh.rest_position_W);
  }
}

std::optional<Eigen::Vector3d> WayIn::between(const Eigen::Vector3d& from_W,
                                              const Eigen::Vector3d& to_W) const noexcept {
  const Eigen::Vector3d path_W = to_W - from_W;
  if (!shape_) {
    return surface_.first_hit(from_W, path_W);
  }
  // Sphere tracing: each step is as long as the gap, so the tool never crosses the surface.
  const double length_m = path_W.norm();
  double gone_m = 0.0;
  for (int trace = 0; trace < kMaxTraces && length_m > 0.0; ++trace) {
    const Eigen::Vector3d here_W = from_W + gone_m / length_m * path_W;
    const auto near = tree_->nearest(*shape_, here_W, length_m - gone_m + kTouching_m);
    if (!near) {
      return std::nullopt;
    }
    if (near->touch.gap_m <= kTouching_m) {
      return here_W;
    }
    gone_m = std::min(length_m, gone_m + near->touch.gap_m);
  }
  return std::nullopt;
}

}  // namespace forcegrid::simulator
