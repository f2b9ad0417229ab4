// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "calibration/rig.h"
#include "calibration/rigid_body.h"
#include "servo_loop/motor_check.h"

namespace forcegrid::calibration {

/// Whether each motor moves its joint in the profile's direction, by servo::MotorCheck: a few
/// pushes of 16 ms. Somebody may hold the device.
/// @returns each joint's verdict; kRunning for joints that were not checked because one before them
///   failed.
/// @throws what Rig::step() throws, and CalibrationError if the check does not come to an end.
std::array<servo::MotorCheck::Verdict, 3> check_directions(Rig& rig,
                                                           const profiles::DeviceProfile& profile,
                                                           RigidBody& body);

}  // namespace forcegrid::calibration
