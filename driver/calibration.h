// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// Makes the counters absolute with a person's help. Motors are without force all the while.
///
/// An arm, which has no index pulse: a person holds it in its calibration pose and presses the
/// calibration button; then the counters are set to the pose's counts. A Falcon: a person moves the
/// knob out and in until the device says of all three axes that they have passed their reference;
/// one that is homed already needs no person.
/// @param timeout    how long the person may take.
/// @param on_prompt  called once, on this thread, with what to do, if anything; may be empty.
/// @param cancelled  asked every few milliseconds; true gives up. May be empty.
/// @returns false when it was cancelled.
/// @throws DeviceError when the button is not pressed, or an axis is not homed, in time, or the
///         device fails.
/// Real-time: no; before the loop. Threads: as Device::newest_report().
bool calibrate(Device& device, const profiles::DeviceProfile& profile, rt::Duration timeout,
               const std::function<void(const std::string&)>& on_prompt = {},
               const std::function<bool()>& cancelled = {});

/// Sets the counters at once: the caller knows that the arm is in its calibration pose. Those of a
/// wrist are first set to other values, which shows whether the device has them.
/// @throws DeviceError when the device does not take them (a Falcon never does), or has no counters
/// for the wrist of its profile.
/// Real-time: no; before the loop. Threads: as Device::newest_report().
void calibrate_now(Device& device, const profiles::DeviceProfile& profile);

#pragma GCC visibility pop
}  // namespace forcegrid::driver
