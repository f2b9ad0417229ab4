// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/device_options.h"

#include <stdexcept>
#include <string>

namespace forcegrid::emulator {

namespace {

constexpr std::array<const char*, kHands> kHandNames = {"firm", "light", "none", "arm"};

}  // namespace

const char* to_string(HandKind hand) noexcept { return kHandNames[static_cast<std::size_t>(hand)]; }

std::optional<HandKind> find_hand(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kHands; ++i) {
    if (name == kHandNames[i]) {
      return static_cast<HandKind>(i);
    }
  }
  return std::nullopt;
}

HandKind parse_hand(std::string_view name) {
  if (const auto hand = find_hand(name)) {
    return *hand;
  }
  throw std::invalid_argument("hand '" + std::string(name) +
                              "' is unknown; use light, firm, arm or none");
}

Hands hands_of(const profiles::DeviceProfile& profile) {
  Hands hands;
  hands[static_cast<std::size_t>(HandKind::kFirm)] = profile.firm_hand;
  hands[static_cast<std::size_t>(HandKind::kLight)] = profile.light_hand;
  hands[static_cast<std::size_t>(HandKind::kArm)] = profiles::arm_hand();
  return hands;
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

}  // namespace forcegrid::emulator
