// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/sticky_contact.h"

#include <cmath>
#include <string>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {

StickyContact::StickyContact(const SpringMesh& mesh, const ContactOptions& options)
    : options_(options), surface_(mesh) {
  check_positive(options.patch_radius_m, "contact: patch_radius_m");
  if (!(options.approach_distance_m >= 0.0) || !std::isfinite(options.approach_distance_m)) {
    throw Error("contact: approach_distance_m is " + std::to_string(options.approach_distance_m) +
                "; it must be finite and >= 0");
  }
  if (options.tool) {
    tree_.emplace(mesh.triangles, mesh.rest_position_W);
  }
}

std::optional<Eigen::Vector3d> StickyContact::expected_touch(const Eigen::Vector3d& position_W,
                                                             const Eigen::Vector3d& velocity_W,
                                                             double within_s) const noexcept {
  if (in_contact_ || must_leave_first_ || !position_W.allFinite() || !velocity_W.allFinite()) {
    return std::nullopt;
  }
  return surface_.first_hit(position_W, within_s * velocity_W);
}

void StickyContact::turn_to(const Eigen::Quaterniond& orientation_WT) noexcept {
  if (!orientation_WT.coeffs().allFinite()) {
    return;
  }
  orientation_WT_ = orientation_WT.normalized();
  if (options_.tool) {
    options_.tool->set_orientation(orientation_WT_);
  }
}

bool StickyContact::at_surface(const Eigen::Vector3d& position_W) const noexcept {
  const RestSurface::Vertical vertical = surface_.look(position_W);
  const bool sinking = last_position_W_ && position_W.z() < last_position_W_->z();
  if (vertical.inside) {
    return true;
  }
  if (tree_) {
    const auto near = tree_->nearest(*options_.tool, position_W, options_.approach_distance_m);
    return near && (near->touch.gap_m <= 0.0 || sinking);
  }
  return sinking && vertical.below_m && *vertical.below_m <= options_.approach_distance_m;
}

}  // namespace forcegrid::simulator
