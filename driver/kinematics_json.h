// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>

#include "profiles/device_profile.h"

namespace forcegrid::driver {

/// The `forcegrid kinematics` command: one JSON object, indented, in the device frame D.
///
/// From counts: `profile`, `frame` ("device"), `status` ("ok" or "beyond the hard stops"),
/// `position_m`, `joint_angles_rad` (q, the angles of the device sheets), `jacobian_m_per_rad`
/// (rows x, y, z); with a force also `force_N`, `joint_torque_Nm` (J^T F), `current_A` (not
/// limited) and `report_mA` (limited and truncated as it would be sent), `report_clamped`. Without
/// a force these are given for zero force.
///
/// For a delta, position and force are in its base frame (`frame` is "base": x right, y up, z out
/// toward the user), the joint angles are those of the driven arms, and instead of the currents
/// there are `command` (scaled together and truncated as they would be sent) and `command_scaled`.
/// @param counts   encoder counts a, b, c (legs 1, 2, 3); need not be whole.
/// @param force_N  in D (delta: in the base frame).
/// @throws DeviceError for a singular pose and for a NaN or infinity, naming input and remedy.
/// Real-time: no. Threads: any.
std::string kinematics_json_from_counts(const profiles::DeviceProfile& profile,
                                        const std::array<double, 3>& counts,
                                        const std::array<double, 3>& force_N = {});

/// The same for a position in D (delta: in the base frame): the inverse, then as above, and
/// `counts` (not rounded).
/// @throws DeviceError for a position out of reach or singular, and for a NaN or infinity.
/// Real-time: no. Threads: any.
std::string kinematics_json_from_position(const profiles::DeviceProfile& profile,
                                          const std::array<double, 3>& position_m,
                                          const std::array<double, 3>& force_N = {});

}  // namespace forcegrid::driver
