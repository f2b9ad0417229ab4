// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "profiles/device_profile.h"
#include "text/toml_table.h"

namespace forcegrid::profiles {

/// Reads and checks the optional table [gimbal] of an arm; not present if `root` has none.
/// @param pose_counts  calibration.pose_counts, which must lie within the wrist's hard stops.
/// @throws text::TomlError for a wrist that none can be, among them one whose encoders have no
///         counts. Real-time: no. Threads: any.
DeviceProfile::Gimbal read_gimbal(const text::TomlTable& root,
                                  const std::array<int, 6>& pose_counts);

/// Reads and checks the optional table [gimbal_motors]; not present if `root` has none. It goes
/// with [gimbal] and with the protocol "w6", whose reports have the currents, and they with it.
/// @param profile  its usb, motors and gimbal have been read.
/// @throws text::TomlError. Real-time: no. Threads: any.
DeviceProfile::GimbalMotors read_gimbal_motors(const text::TomlTable& root,
                                               const DeviceProfile& profile);

}  // namespace forcegrid::profiles
