#pragma once

#include <Eigen/Core>
#include <array>

#include "link/surface_patch.h"

namespace forcegrid::servo {

struct NearSurface;

/// What a tool feels between a touch and the simulator's first answer, from what a patch says.
/// Plain data. With P_0 where the tool touched, n the outward normal there and P the tool's
/// position:
///
/// Of a tool that sticks, with the stiffness J of the patch,
///
///   F = J (P - P_0).
///
/// Of a tool that slides, with the forces F_1 and F_2 at the depths h = 1 mm and 2 h of the patch
/// and the depth d = -n.(P - P_0) > 0,
///
///   n.F = n.F_1 (d / h)^p,  p = log2(n.F_2 / n.F_1) cut to [1, 2]:  1.5 is Hertz's,
///
/// and along the surface (friction) the share of n.F that F_1 has, or F_2, or one between for a
/// depth between, less what would help the tool on its way along the surface since P_0.
///
/// Either is cut to n.F >= 0 and |F - (n.F) n| <= n.F, at most max_force_N. Without J, F_1 and F_2
/// there is no force.
///
/// Real-time: no allocation, lock or throw, at most one pow(). Threads: a value.
class TouchForce {
 public:
  explicit TouchForce(double max_force_N) noexcept : max_force_N_(max_force_N) {}

  /// The tool has touched `surface` at `point_W` [m], P_0, under `normal_W`, n.
  void begin(const NearSurface& surface, const Eigen::Vector3d& point_W,
             const Eigen::Vector3d& normal_W) noexcept;

  /// The patch has said what is felt; else at() is zero everywhere.
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
