#include "driver/device.h"

namespace forcegrid::driver {

const char* to_string(DeviceHealth health) noexcept {
  switch (health) {
    case DeviceHealth::kRunning:
      return "device running";
    case DeviceHealth::kStale:
      return "device silent";
    case DeviceHealth::kUnplugged:
      return "device unplugged";
    case DeviceHealth::kProtocol:
      return "device broke the protocol";
    case DeviceHealth::kClosed:
      return "device closed";
  }
  return "device in an unknown state";
}

}  // namespace forcegrid::driver
