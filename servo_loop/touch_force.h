// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "link/surface_patch.h"

namespace forcegrid::servo {

struct NearSurface;

/// The force between a touch and the simulator's first answer, predicted from a surface patch.
/// Plain data. P_0 is where the tool touched, n the outward normal there, P the tool's position.
///
/// For a tool that sticks, with the patch's stiffness J,
///
///   F = J (P - P_0).
///
/// For a tool that slides, with the patch's forces F_1 and F_2 at the depths h = 1 mm and 2 h, and
/// the depth d = -n.(P - P_0) > 0,
///
///   n.F = n.F_1 (d / h)^p,  p = log2(n.F_2 / n.F_1) clamped to [1, 2]  (Hertz: 1.5).
///
/// Its friction along the surface is a share of n.F, interpolated in depth between those of F_1 and
/// F_2, without any part that would push the tool along its own way since P_0.
///
/// Both are clamped to n.F >= 0, |F - (n.F) n| <= n.F, and at most max_force_N. A patch with
/// neither J nor F_1 and F_2 gives no force.
///
/// Real-time: no allocation, lock or throw, at most one pow(). Threads: a value.
class TouchForce {
 public:
  explicit TouchForce(double max_force_N) noexcept : max_force_N_(max_force_N) {}

  /// The tool has touched `surface` at `point_W` [m] (P_0) with the outward normal `normal_W` (n).
  void begin(const NearSurface& surface, const Eigen::Vector3d& point_W,
             const Eigen::Vector3d& normal_W) noexcept;

  /// The patch predicts a force; otherwise at() is zero everywhere.
  bool known() const noexcept { return known_; }

  /// [N] at `position_W` [m].
  Eigen::Vector3d at(const Eigen::Vector3d& position_W) const noexcept;

  /// [m] of `position_W` above P_0 along n, negative inside.
  double height_m(const Eigen::Vector3d& position_W) const noexcept {
    return normal_W_.dot(position_W - point_W_);
  }

 private:
  void take_press_forces(
      const std::array<std::array<double, 3>, link::SurfacePatch::kPresses>& forces_W_N) noexcept;
  Eigen::Vector3d sticking_force_W(const Eigen::Vector3d& position_W) const noexcept;
  Eigen::Vector3d sliding_force_W(const Eigen::Vector3d& position_W) const noexcept;

  double max_force_N_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal_W_ = Eigen::Vector3d::UnitZ();
  bool known_ = false;
  bool slides_ = false;
  Eigen::Matrix3d stiffness_W_N_per_m_ = Eigen::Matrix3d::Zero();
  double press_N_ = 0.0;  ///< n.F_1
  double exponent_ = 1.0;
  /// (F - (n.F) n) / (n.F) at h and 2 h.
  std::array<Eigen::Vector3d, link::SurfacePatch::kPresses> along_{};
};

}  // namespace forcegrid::servo
