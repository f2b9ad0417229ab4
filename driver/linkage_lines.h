// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {

/// Joints of one chain of links, from the base to the tip [m], frame D.
using LinkageLine = std::vector<Eigen::Vector3d>;

/// [m] In pictures, since no profile has the length of a stylus.
inline constexpr double kStylus_m = 0.05;
inline constexpr double kPointer_m = 0.015;

/// Where a device's links are, for pictures: for an arm base, shoulder, elbow and tip; for a delta
/// hip, knee, the platform's joint and tip of each leg; for a wrist the stylus, kStylus_m along x
/// of the tool's frame, and a pointer of kPointer_m along its z, which shows the roll. All lines
/// end at pose.position_D. Source: ArmKinematics and DeltaKinematics, whose equations these points
/// are steps of.
/// @returns nothing for a pose whose values are not valid. Real-time: no. Threads: any.
std::vector<LinkageLine> linkage_lines(const profiles::DeviceProfile& profile, const ArmPose& pose);

}  // namespace forcegrid::driver
