// SPDX-License-Identifier: Apache-2.0
#include "evaluation/objects/wall.h"

#include <cmath>
#include <numbers>

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Wall tilted_wall() {
  constexpr double kTilt_rad = 25.0 * std::numbers::pi / 180.0;
  return {.normal_W = {std::sin(kTilt_rad), 0.0, std::cos(kTilt_rad)}};
}

Wall side_wall() {
  return {
      .normal_W = Vector3d::UnitX(), .surface_W_m = {0.009, 0.0, 0.0}, .stiffness_N_per_m = 700.0};
}

}  // namespace

double Wall::depth_m(const Vector3d& displacement_W) const noexcept {
  if (radius_m > 0.0) {
    return radius_m - (displacement_W - surface_W_m - radius_m * normal_W).norm();
  }
  return normal_W.dot(displacement_W - surface_W_m);
}

Wall::Value Wall::at(const Vector3d& displacement_W) const noexcept {
  Vector3d up = normal_W;  // grad s
  Matrix3d bend = Matrix3d::Zero();
  if (radius_m > 0.0) {
    const Vector3d to_centre_m = surface_W_m + radius_m * normal_W - displacement_W;
    const double distance_m = to_centre_m.norm();
    up = to_centre_m / distance_m;
    bend = (up * up.transpose() - Matrix3d::Identity()) / distance_m;
  }
  const double s_m = depth_m(displacement_W);
  double phi_m = s_m > 0.0 ? s_m : 0.0;
  double slope = s_m > 0.0 ? 1.0 : 0.0;
  if (softness_m > 0.0) {
    const double fade = std::exp(-std::abs(s_m) / softness_m);
    phi_m += softness_m * std::log1p(fade);
    slope = (s_m > 0.0 ? 1.0 : fade) / (1.0 + fade);
  }
  const double push_N = stiffness_N_per_m * phi_m + stiffening_N_per_m2 * phi_m * phi_m;
  const double push_N_per_m = (stiffness_N_per_m + 2.0 * stiffening_N_per_m2 * phi_m) * slope;
  return {-push_N * up, -push_N_per_m * up * up.transpose() - push_N * bend};
}

const std::vector<NamedWalls>& named_walls() {
  static const std::vector<NamedWalls> all{
      {"wall_flat", "a wall of 1000 N/m 14 mm up", {Wall{}}},
      {"wall_tilted", "a wall of 1000 N/m tilted by 25 degrees", {tilted_wall()}},
      {"wall_curved", "a ball of 20 mm and 1000 N/m", {{.radius_m = 0.020}}},
      {"wall_stiffening",
       "a wall of 500 N/m and 1e5 N/m^2",
       {{.stiffness_N_per_m = 500.0, .stiffening_N_per_m2 = 1e5}}},
      {"wall_soft", "a wall of 1000 N/m with a soft edge", {{.softness_m = 0.5e-3}}},
      {"wall_two", "walls of 1000 N/m above and 700 N/m at the side", {Wall{}, side_wall()}}};
  return all;
}

}  // namespace forcegrid::evaluation
