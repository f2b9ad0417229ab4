// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/emergency_stop.h"

namespace forcegrid::servo {

const char* name_of(EmergencySource source) noexcept {
  switch (source) {
    case EmergencySource::kNone:
      return "none";
    case EmergencySource::kSignal:
      return "signal";
    case EmergencySource::kKey:
      return "key";
    case EmergencySource::kDeviceButton:
      return "device_button";
    case EmergencySource::kView:
      return "view";
  }
  return "invalid";
}

const char* words_of(EmergencySource source) noexcept {
  switch (source) {
    case EmergencySource::kNone:
      return "nobody";
    case EmergencySource::kSignal:
      return "the signal SIGUSR1";
    case EmergencySource::kKey:
      return "a key";
    case EmergencySource::kDeviceButton:
      return "a button of the device";
    case EmergencySource::kView:
      return "the stop in the live view";
  }
  return "an unknown source";
}

}  // namespace forcegrid::servo
