// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "calibration/procedure.h"

namespace forcegrid::calibration {

/// Relative standard errors above which a result is not used.
inline constexpr double kLargestScaleError = 0.02;
inline constexpr double kLargestFrictionError = 0.07;

/// The result of a joint's strokes, and whether it is certain enough to be written.
Check friction_check(const profiles::DeviceProfile& profile, int joint, const JointFit& fit,
                     bool absolute);

/// The values that the profile should have instead. Offsets go into the counts of the calibration
/// pose, and only if the device was just homed in it.
std::vector<ProfileChange> profile_changes(const profiles::DeviceProfile& profile, bool homed,
                                           const ProcedureResult& result);

}  // namespace forcegrid::calibration
