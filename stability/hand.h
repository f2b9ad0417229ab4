// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid::stability {

/// Model of the hand that holds the tool: a mass that moves with the tool, tied to a moving target
/// by spring and damper.
///
///   F_hand = k (r - x) + b (r' - x')   [N],  m moves with the tool
struct Hand {
  std::string name;  ///< none, light, firm, arm
  profiles::HandProfile impedance;

  bool holds() const noexcept { return impedance.stiffness_N_per_m > 0.0; }
};

/// Returns no hand, a light grip, a firm grip and a whole arm, in order of rising mass. Each names
/// its source.
const std::vector<Hand>& hands();

/// @throws std::invalid_argument for an unknown name, listing the known ones.
const Hand& hand_of(const std::string& name);

}  // namespace forcegrid::stability
