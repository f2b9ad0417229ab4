// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/delta_mechanism.h"

#include <cmath>

namespace forcegrid::emulator {

using Eigen::Vector3d;

DeltaMechanism::DeltaMechanism(const profiles::DeviceProfile::Delta& delta) noexcept
    : thigh_m_(delta.thigh_m),
      shin_m_(delta.shin_m),
      shin_ends_m_(delta.knee_end_m + delta.platform_end_m),
      offset_u_m_(delta.platform_offset_u_m - delta.base_offset_u_m),
      offset_v_m_(delta.platform_offset_v_m - delta.base_offset_v_m),
      center_B_(delta.center_m.data()) {
  for (int leg = 0; leg < 3; ++leg) {
    const double azimuth_rad = delta.leg_azimuth_rad[static_cast<std::size_t>(leg)];
    cos_azimuth_[leg] = std::cos(azimuth_rad);
    sin_azimuth_[leg] = std::sin(azimuth_rad);
  }
}

std::optional<DeltaMechanism::Pose> DeltaMechanism::pose(
    const Vector3d& position_D) const noexcept {
  const Vector3d position_B = to_base(position_D);
  const double w = position_B.z();
  Pose result;
  for (int leg = 0; leg < 3; ++leg) {
    const double cosine = cos_azimuth_[leg];
    const double sine = sin_azimuth_[leg];
    const double u = position_B.x() * cosine + position_B.y() * sine + offset_u_m_;
    const double v = -position_B.x() * sine + position_B.y() * cosine + offset_v_m_;

    const double shin_out = shin_m_ * shin_m_ - v * v;  // (b sin theta_3)^2
    if (!(shin_out > 0.0)) {
      return std::nullopt;
    }
    const double in_plane = std::sqrt(shin_out);
    const double shin = shin_ends_m_ + in_plane;
    const double reach = std::hypot(u, w);
    const double cos_knee =
        (reach * reach + thigh_m_ * thigh_m_ - shin * shin) / (2.0 * thigh_m_ * reach);
    if (!(std::abs(cos_knee) < 1.0)) {
      return std::nullopt;
    }
    const double theta_1 = std::atan2(w, u) - std::acos(cos_knee);
    // Knee to platform, of length `shin`: its direction is theta_2.
    const double knee_u = u - thigh_m_ * std::cos(theta_1);
    const double knee_w = w - thigh_m_ * std::sin(theta_1);
    const double cos_2 = knee_u / shin;
    const double sin_2 = knee_w / shin;
    const double lever = thigh_m_ * (sin_2 * std::cos(theta_1) - cos_2 * std::sin(theta_1));
    if (!(lever > 0.0)) {
      return std::nullopt;
    }
    const double cot_3 = v / in_plane;
    result.joint_angle_rad[leg] = theta_1;
    const double by_x = (cos_2 * cosine - cot_3 * sine) / lever;
    const double by_y = (cos_2 * sine + cot_3 * cosine) / lever;
    const double by_z = sin_2 / lever;
    // Columns of D: x_D along z_B, y_D along x_B, z_D along y_B.
    result.rate_rad_per_m.row(leg) << by_z, by_x, by_y;
  }
  return result;
}

Vector3d DeltaMechanism::bias_rad_per_s2(const Vector3d& position_D,
                                         const Vector3d& velocity_D_m_per_s) const noexcept {
  constexpr double kStep_m = 1e-5;
  const double speed = velocity_D_m_per_s.norm();
  if (!(speed > 0.0)) {
    return Vector3d::Zero();
  }
  const Vector3d step_D = velocity_D_m_per_s * (kStep_m / speed);
  const auto ahead = pose(position_D + step_D);
  const auto behind = pose(position_D - step_D);
  if (!ahead || !behind) {
    return Vector3d::Zero();
  }
  return (ahead->rate_rad_per_m - behind->rate_rad_per_m) * velocity_D_m_per_s *
         (speed / (2.0 * kStep_m));
}

}  // namespace forcegrid::emulator
