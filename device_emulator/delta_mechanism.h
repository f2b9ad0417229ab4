// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Geometry of the emulated delta: the place of its knob decides everything else. Written from the
/// device sheet alone, so that a fault in the driver's kinematics cannot hide in it.
///
/// In the base frame B (x to the user's right, y up, z out of the device) and for leg i at azimuth
/// phi_i, with p = (x, y, z):
///
///   Q_u = x cos phi + y sin phi - r + c,   Q_v = -x sin phi + y cos phi - s + f,   Q_w = z
///   theta_3 = acos(Q_v / b),   L = d + e + b sin theta_3,   R = hypot(Q_u, Q_w)
///   theta_1 = atan2(Q_w, Q_u) - acos((R^2 + a^2 - L^2) / (2 a R))             driven angle
///   theta_2 = atan2(Q_w - a sin theta_1, Q_u - a cos theta_1)                 shin
///   theta_1' = (cos theta_2 Q_u' + cot theta_3 Q_v' + sin theta_2 Q_w')
///              / (a sin(theta_2 - theta_1))
///
/// Positions and rates are those of the device frame D: x_D = z_B - center_z, y_D = x_B - center_x,
/// z_D = y_B - center_y.
///
/// Source: R. E. Stamper, thesis (1997), eqs 3.7 to 3.22; the rate by differentiating the closure
/// L^2 = (Q_u - a cos theta_1)^2 + (Q_w - a sin theta_1)^2. Numbers from the profile.
/// Real-time: no allocation, lock or throw. Threads: const, no hidden state.
class DeltaMechanism {
 public:
  /// The legs at one place.
  struct Pose {
    Eigen::Vector3d joint_angle_rad;  ///< theta_1 of legs 1 to 3
    Eigen::Matrix3d rate_rad_per_m;   ///< d(theta_1)/dx_D, rows legs
  };

  explicit DeltaMechanism(const profiles::DeviceProfile::Delta& delta) noexcept;

  /// @returns nothing where the legs do not close, or where a stretched or folded leg (theta_2 =
  ///   theta_1, sin theta_3 = 0) has no rate.
  [[nodiscard]] std::optional<Pose> pose(const Eigen::Vector3d& position_D) const noexcept;

  /// d/dt(rate) v, the angular acceleration [rad/s^2] left at constant velocity v [m/s] of the
  /// knob; by a central difference over 2 * 10 um, whose error is about 1e-7 of it. Zero next to
  /// places without a pose.
  [[nodiscard]] Eigen::Vector3d bias_rad_per_s2(
      const Eigen::Vector3d& position_D, const Eigen::Vector3d& velocity_D_m_per_s) const noexcept;

  /// [m] The same place in B, and the reverse.
  [[nodiscard]] Eigen::Vector3d to_base(const Eigen::Vector3d& position_D) const noexcept {
    return Eigen::Vector3d(position_D.y(), position_D.z(), position_D.x()) + center_B_;
  }
  [[nodiscard]] Eigen::Vector3d from_base(const Eigen::Vector3d& position_B) const noexcept {
    const Eigen::Vector3d offset_B = position_B - center_B_;
    return {offset_B.z(), offset_B.x(), offset_B.y()};
  }

 private:
  double thigh_m_;
  double shin_m_;
  double shin_ends_m_;  // d + e
  double offset_u_m_;   // c - r
  double offset_v_m_;   // f - s
  Eigen::Vector3d cos_azimuth_;
  Eigen::Vector3d sin_azimuth_;
  Eigen::Vector3d center_B_;
};

}  // namespace forcegrid::emulator
