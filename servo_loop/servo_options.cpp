// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/servo_options.h"

#include <stdexcept>

#include "servo_loop/device_button.h"

namespace forcegrid::servo {

void require_usable(const ServoOptions& options, const profiles::DeviceProfile& profile) {
  if (!(options.rate_Hz >= 100.0 && options.rate_Hz <= 4000.0)) {
    throw std::invalid_argument("servo rate: use 100 to 4000 Hz");
  }
  if (!(options.simulator_rate_Hz > 0.0 && options.simulator_rate_Hz <= 4000.0)) {
    throw std::invalid_argument("simulator rate: use more than 0 and at most 4000 Hz");
  }
  if (!(options.requests_per_s >= 0.0 && options.requests_per_s <= options.rate_Hz)) {
    throw std::invalid_argument("requests: use 0 to one per servo cycle");
  }
  if (options.dead_man == DeadMan::kButton && !DeviceButton::can_be_held(profile)) {
    throw std::invalid_argument("dead man: profile " + profile.name +
                                " describes a device without a button that can be held");
  }
  if (options.dead_man == DeadMan::kSignal && options.dead_man_signal == nullptr) {
    throw std::invalid_argument("dead man: the signal is missing");
  }
  if (options.dead_man == DeadMan::kSwitch && options.force_switch == nullptr) {
    throw std::invalid_argument("dead man: the switch is missing");
  }
  if (options.fill_budget < 1) {
    throw std::invalid_argument("fill budget: use at least 1 per cycle");
  }
}

}  // namespace forcegrid::servo
