#include "device_emulator/emulated_device.h"

#include "device_emulator/emulated_falcon.h"
#include "device_emulator/emulated_w2.h"

namespace forcegrid::emulator {

std::unique_ptr<EmulatedDevice> make_emulated_device(const DeviceOptions& options,
                                                     rt::TimePoint start) {
  if (options.profile.kind == profiles::DeviceKind::kDelta) {
    return std::make_unique<EmulatedFalcon>(options, start);
  }
  return std::make_unique<EmulatedW2>(options, start);
}

}  // namespace forcegrid::emulator
