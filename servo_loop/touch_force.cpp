// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/touch_force.h"

#include <algorithm>
#include <cmath>

#include "servo_loop/first_touch.h"

namespace forcegrid::servo {
namespace {

constexpr double kLeastExponent = 1.0;
constexpr double kMostExponent = 2.0;

}  // namespace

void TouchForce::begin(const NearSurface& surface, const Eigen::Vector3d& point_W,
                       const Eigen::Vector3d& normal_W) noexcept {
  point_W_ = point_W;
  normal_W_ = normal_W;
  slides_ = surface.has_press_forces;
  stiffness_W_N_per_m_.setZero();
  press_N_ = 0.0;
  known_ = false;
  if (slides_) {
    take_press_forces(surface.press_forces_W_N);
  } else if (surface.has_stiffness) {
    known_ = true;
    stiffness_W_N_per_m_ = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
        surface.stiffness_W_N_per_m.data());
  }
}

void TouchForce::take_press_forces(
    const std::array<std::array<double, 3>, link::SurfacePatch::kPresses>& forces_W_N) noexcept {
  std::array<double, link::SurfacePatch::kPresses> push_N{};
  for (std::size_t k = 0; k < push_N.size(); ++k) {
    const Eigen::Map<const Eigen::Vector3d> force_W(forces_W_N[k].data());
    push_N[k] = normal_W_.dot(force_W);
    if (!(push_N[k] > 0.0)) {
      return;  // nothing that a tool could press against
    }
    along_[k] = (force_W - push_N[k] * normal_W_) / push_N[k];
  }
  known_ = true;
  press_N_ = push_N[0];
  exponent_ = std::clamp(std::log2(push_N[1] / push_N[0]), kLeastExponent, kMostExponent);
}

Eigen::Vector3d TouchForce::sticking_force_W(const Eigen::Vector3d& position_W) const noexcept {
  return stiffness_W_N_per_m_ * (position_W - point_W_);
}

Eigen::Vector3d TouchForce::sliding_force_W(const Eigen::Vector3d& position_W) const noexcept {
  const double depth = -height_m(position_W) / link::SurfacePatch::kPressDepth_m;  // in h
  if (!(depth > 0.0)) {
    return Eigen::Vector3d::Zero();
  }
  const double push_N = press_N_ * std::pow(depth, exponent_);
  const double share = std::clamp(depth - 1.0, 0.0, 1.0);
  Eigen::Vector3d along_W = push_N * ((1.0 - share) * along_[0] + share * along_[1]);
  const Eigen::Vector3d way_W =
      position_W - point_W_ - height_m(position_W) * normal_W_;  // along the surface
  const double helps = along_W.dot(way_W);
  if (helps > 0.0) {
    along_W -= helps / way_W.squaredNorm() * way_W;
  }
  return push_N * normal_W_ + along_W;
}

Eigen::Vector3d TouchForce::at(const Eigen::Vector3d& position_W) const noexcept {
  if (!known_) {
    return Eigen::Vector3d::Zero();
  }
  const Eigen::Vector3d whole_W =
      slides_ ? sliding_force_W(position_W) : sticking_force_W(position_W);
  const double push_N = normal_W_.dot(whole_W);
  if (!(push_N > 0.0)) {
    return Eigen::Vector3d::Zero();
  }
  Eigen::Vector3d along_W = whole_W - push_N * normal_W_;
  const double along_N = along_W.norm();
  if (along_N > push_N) {
    along_W *= push_N / along_N;
  }
  const Eigen::Vector3d force_W = push_N * normal_W_ + along_W;
  const double force_N = force_W.norm();
  return force_N > max_force_N_ ? Eigen::Vector3d(max_force_N_ / force_N * force_W) : force_W;
}

}  // namespace forcegrid::servo
