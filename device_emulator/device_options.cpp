// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/device_options.h"

#include <stdexcept>
#include <string>

namespace forcegrid::emulator {

HandKind parse_hand(std::string_view name) {
  if (name == "firm") {
    return HandKind::kFirm;
  }
  if (name == "light") {
    return HandKind::kLight;
  }
  if (name == "none") {
    return HandKind::kNone;
  }
  throw std::invalid_argument("hand '" + std::string(name) +
                              "' is unknown; use firm, light or none");
}

FrameOrder parse_frame_order(std::string_view name) {
  if (name == "out-first") {
    return FrameOrder::kOutFirst;
  }
  if (name == "in-first") {
    return FrameOrder::kInFirst;
  }
  throw std::invalid_argument("frame order '" + std::string(name) +
                              "' is unknown; use out-first or in-first");
}

std::optional<profiles::HandProfile> DeviceOptions::hand_profile() const {
  switch (hand) {
    case HandKind::kFirm:
      return profile.firm_hand;
    case HandKind::kLight:
      return profile.light_hand;
    case HandKind::kNone:
      break;
  }
  return std::nullopt;
}

}  // namespace forcegrid::emulator
