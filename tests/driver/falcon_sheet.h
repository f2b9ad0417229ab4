// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numbers>

#include "driver/delta_kinematics.h"

namespace forcegrid::driver {

/// The Falcon's geometry, typed from the device's fact sheet and not from the profile, so that a
/// mistake in the profile shows.
inline profiles::DeviceProfile::Delta falcon_sheet_geometry() {
  constexpr double kDegree = std::numbers::pi / 180.0;
  return {.thigh_m = 0.060,
          .shin_m = 0.1025,
          .platform_offset_u_m = 0.01443,
          .knee_end_m = 0.01125,
          .platform_end_m = 0.01125,
          .platform_offset_v_m = -0.025,
          .base_offset_u_m = 0.0400,
          .base_offset_v_m = -0.02309,
          .leg_azimuth_rad = {105.0 * kDegree, -15.0 * kDegree, -135.0 * kDegree},
          .encoder_rad_per_count = 360.0 / 1280.0 * 0.01425 / 0.110 * kDegree,
          .zero_angle_rad = 35.0 * kDegree,
          .joint_min_rad = -2.0,  // wide, so that only the mechanism limits
          .joint_max_rad = 2.0};
}

}  // namespace forcegrid::driver
