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

}  // namespace forcegrid::profiles
