// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/unilateral_constraint.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

// Two directions across a unit vector.
void tangents(const Vector3d& n, Vector3d& first, Vector3d& second) noexcept {
  int least = 0;
  n.cwiseAbs().minCoeff(&least);
  first = n.cross(Vector3d::Unit(least)).normalized();
  second = n.cross(first);
}

}  // namespace

// Softplus.
double UnilateralConstraint::penetration_m(double s_m) const noexcept {
  const double ratio = s_m / softness_m;
  if (ratio > 30.0) {
    return s_m;
  }
  return ratio < -30.0 ? 0.0 : softness_m * std::log1p(std::exp(ratio));
}

UnilateralConstraint::At UnilateralConstraint::at(const Vector3d& position_W) const noexcept {
  const Vector3d from_surface_m = position_W - anchor_W + depth_m * normal_W;
  const Vector3d w = normal_W - curvature_per_m * from_surface_m;
  const double length = w.norm();
  // (1 - |w|) / c, written so that it keeps its digits near c = 0.
  const double s_m =
      (2.0 * normal_W.dot(from_surface_m) - curvature_per_m * from_surface_m.squaredNorm()) /
      (1.0 + length);
  const bool has_direction = length > 1e-9;  // at a ball's centre there is none
  return {s_m, penetration_m(s_m), has_direction ? Vector3d(w / length) : normal_W};
}

double UnilateralConstraint::prior_nats() const noexcept {
  const double bent = curvature_per_m / kCurvature_per_m;
  const double soft = std::log(softness_m / kUsualSoftness_m) / kLnSoftness;
  return 0.5 * (bent * bent + soft * soft);
}

UnilateralConstraint UnilateralConstraint::moved(const Parameters& step) const noexcept {
  UnilateralConstraint result = *this;
  Vector3d first;
  Vector3d second;
  tangents(normal_W, first, second);
  result.normal_W =
      (normal_W + kUnit[0] * step[0] * first + kUnit[1] * step[1] * second).normalized();
  result.depth_m += kUnit[2] * step[2];
  result.curvature_per_m += kUnit[3] * step[3];
  result.softness_m = std::clamp(softness_m * std::exp(kUnit[4] * step[4]), kHardest_m, kSoftest_m);
  return result;
}

}  // namespace forcegrid::kriging
