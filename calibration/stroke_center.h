// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// The pose about which the joints are moved. A delta: with the knob in the middle. An arm:
/// straight ahead, clear of all stops, not too close to its axis, and where links and known mass
/// load the motors least, as a share of their continuous current.
/// @throws CalibrationError if there is no such place.
Eigen::Vector3d stroke_center_rad(const profiles::DeviceProfile& profile, double known_mass_kg);

/// How far a joint may be moved from there to either side, clear of the stops.
double stroke_amplitude_rad(const profiles::DeviceProfile& profile,
                            const Eigen::Vector3d& center_rad, int joint);

/// The pose at joint angles.
driver::ArmPose pose_at(const profiles::DeviceProfile& profile, const Eigen::Vector3d& angle_rad);

}  // namespace forcegrid::calibration
