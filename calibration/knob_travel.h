// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "calibration/held_arm.h"

namespace forcegrid::calibration {

/// Where the knob of a delta meets the device's body: z of the base frame B, out of the device.
struct KnobTravel {
  double in_m = 0.0;
  double out_m = 0.0;
};

/// [m] If a knob meets the body farther than this from the profile's place, its angles are not
/// those of its counters.
inline constexpr double kTravelTolerance_m = 0.002;

/// Pushes the knob gently in and pulls it out along the device's axis until it does not follow. The
/// body is far stiffer than the push, so this measures the body's place, for all three legs
/// together.
/// @param center_rad  where the knob begins and ends.
/// @throws as HeldArm::step(), and CalibrationError if there is no stop.
KnobTravel measure_travel(HeldArm& arm, const profiles::DeviceProfile& profile,
                          const Eigen::Vector3d& center_rad);

}  // namespace forcegrid::calibration
