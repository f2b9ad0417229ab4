// SPDX-License-Identifier: Apache-2.0
#include "contact/tool_shape.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "contact/error.h"

namespace forcegrid::contact {
namespace {

void check(const char* name, double value, double low, double high, const char* unit) {
  if (!(value >= low && value <= high)) {
    throw Error("tool: " + std::string(name) + " is " + std::to_string(value) + " " + unit +
                "; give " + std::to_string(low) + " to " + std::to_string(high));
  }
}

void check_radius(double radius_m) {
  check("radius", radius_m, ToolShape::kMinRadius_m, ToolShape::kMaxRadius_m, "m");
}

}  // namespace

ToolShape ToolShape::sphere(double radius_m) {
  ToolShape shape = capsule(radius_m, 0.0);
  shape.kind_ = Kind::kSphere;
  return shape;
}

ToolShape ToolShape::capsule(double radius_m, double length_m, const Eigen::Vector3d& axis_W) {
  check_radius(radius_m);
  check("length", length_m, 0.0, kMaxLength_m, "m");
  if (!axis_W.allFinite() || !(axis_W.norm() > 0.0)) {
    throw Error("tool: its axis has no direction; give three numbers that are not all zero");
  }
  const Eigen::Vector3d along = axis_W.normalized();
  ToolShape shape;
  shape.kind_ = Kind::kCapsule;
  shape.count_ = 1;
  shape.length_m_ = length_m;
  shape.upright_[0] = {radius_m * along, (radius_m + length_m) * along, radius_m};
  shape.turn_parts();
  return shape;
}

ToolShape ToolShape::blade(double radius_m, double length_m) {
  ToolShape shape = capsule(radius_m, length_m);
  const Eigen::Vector3d middle_T(0.0, 0.0, radius_m);
  const Eigen::Vector3d half_T(0.5 * length_m, 0.0, 0.0);
  shape.upright_[0] = {middle_T - half_T, middle_T + half_T, radius_m};
  shape.turn_parts();
  return shape;
}

ToolShape ToolShape::grasper(double radius_m, double length_m, double opening_rad) {
  check_radius(radius_m);
  check("length", length_m, radius_m, kMaxLength_m, "m");
  check("opening", opening_rad, 0.0, kMaxOpening_rad, "rad");
  ToolShape shape;
  shape.kind_ = Kind::kGrasper;
  shape.count_ = 2;
  shape.length_m_ = length_m;
  shape.upright_[0].radius_m = shape.upright_[1].radius_m = radius_m;
  shape.set_opening(opening_rad);
  return shape;
}

void ToolShape::set_opening(double opening_rad) noexcept {
  if (kind_ != Kind::kGrasper || !std::isfinite(opening_rad)) {
    return;
  }
  opening_rad_ = std::clamp(opening_rad, 0.0, kMaxOpening_rad);
  const Eigen::Vector3d hinge_T(0.0, 0.0, upright_[0].radius_m + length_m_);
  const double half_rad = 0.5 * opening_rad_;
  for (std::size_t jaw = 0; jaw < 2; ++jaw) {
    const double side = jaw == 0 ? 1.0 : -1.0;
    upright_[jaw].from_T =
        hinge_T + length_m_ * Eigen::Vector3d(side * std::sin(half_rad), 0.0, -std::cos(half_rad));
    upright_[jaw].to_T = hinge_T;
  }
  turn_parts();
}

void ToolShape::set_orientation(const Eigen::Quaterniond& orientation_WT) noexcept {
  if (!orientation_WT.coeffs().allFinite() || !(orientation_WT.norm() > 0.0)) {
    return;
  }
  orientation_WT_ = orientation_WT.normalized();
  rotation_WT_ = orientation_WT_.toRotationMatrix();
  turn_parts();
}

double ToolShape::reach_m() const noexcept {
  double reach_m = 0.0;
  for (const Capsule& part : parts()) {
    reach_m = std::max(reach_m, part.radius_m + std::max(part.from_T.norm(), part.to_T.norm()));
  }
  return reach_m;
}

void ToolShape::turn_parts() noexcept {
  for (std::size_t part = 0; part < count_; ++part) {
    parts_[part] = {rotation_WT_ * upright_[part].from_T, rotation_WT_ * upright_[part].to_T,
                    upright_[part].radius_m};
  }
}

}  // namespace forcegrid::contact
