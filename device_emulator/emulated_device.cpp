// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulated_device.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "device_emulator/emulated_falcon.h"
#include "device_emulator/emulated_w2.h"
#include "device_emulator/faulty_device.h"

namespace forcegrid::emulator {

bool EmulatedDevice::motors_on() const {
  const EmulatorReport now = report();
  const auto flows = [](double value) { return value != 0.0; };
  return std::any_of(now.final_current_mA.begin(), now.final_current_mA.end(), flows) ||
         std::any_of(now.final_torque_Nm.begin(), now.final_torque_Nm.end(), flows);
}

std::unique_ptr<EmulatedDevice> make_emulated_device(const DeviceOptions& options,
                                                     rt::TimePoint start) {
  for (const FaultSpec& fault : options.faults) {
    if (fault.axis.value_or(0) > 2 && !profiles::has_wrist(options.profile)) {
      throw std::invalid_argument(std::string("fault '") + name_of(fault.kind) +
                                  "' of axis d, e or f needs a wrist, and device '" +
                                  options.profile.name + "' has none; give axis a, b or c");
    }
  }
  std::unique_ptr<EmulatedDevice> device;
  if (options.profile.kind == profiles::DeviceKind::kDelta) {
    device = std::make_unique<EmulatedFalcon>(options, start);
  } else {
    device = std::make_unique<EmulatedW2>(options, start);
  }
  if (options.faults.empty()) {
    return device;
  }
  return std::make_unique<FaultyDevice>(std::move(device), options.profile, options.faults, start);
}

}  // namespace forcegrid::emulator
