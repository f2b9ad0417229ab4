// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "calibration/procedure.h"

namespace forcegrid::calibration {

/// Standard errors, relative, above which a result is not believed.
inline constexpr double kLargestScaleError = 0.02;
inline constexpr double kLargestFrictionError = 0.07;

/// What the strokes of a joint say, and whether it is certain enough to be written.
Check friction_check(const profiles::DeviceProfile& profile, int joint, const JointFit& fit,
                     bool absolute);

/// What the profile should have instead. Offsets go into the counts of the calibration pose, and
/// only if the device was homed in it just now.
std::vector<ProfileChange> profile_changes(const profiles::DeviceProfile& profile, bool homed,
                                           const ProcedureResult& result);

}  // namespace forcegrid::calibration
