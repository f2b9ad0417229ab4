// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>

#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// "a (base)", or for a delta "1 (top)": the joint's name as a person finds it on the device.
inline std::string joint_name(const profiles::DeviceProfile& profile, int joint) {
  constexpr std::array<const char*, 3> kArm = {"a (base)", "b (shoulder)", "c (elbow)"};
  constexpr std::array<const char*, 3> kDelta = {"1 (top)", "2 (right)", "3 (left)"};
  const auto index = static_cast<std::size_t>(joint);
  return profile.kind == profiles::DeviceKind::kDelta ? kDelta[index] : kArm[index];
}

}  // namespace forcegrid::calibration
