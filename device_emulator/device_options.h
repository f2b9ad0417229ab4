// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "device_emulator/fault_spec.h"
#include "device_emulator/operator_script.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {
#pragma GCC visibility push(default)

/// How the operator's hand holds the device.
enum class HandKind : std::uint8_t { kFirm, kLight, kNone, kArm };
inline constexpr std::size_t kHands = 4;
/// "firm", "light", "arm" or "none". @throws std::invalid_argument for anything else.
HandKind parse_hand(std::string_view name);
/// The same; nothing for anything else. Real-time: yes.
std::optional<HandKind> find_hand(std::string_view name) noexcept;
const char* to_string(HandKind hand) noexcept;

/// A device's hands by HandKind; nothing for kNone.
using Hands = std::array<std::optional<profiles::HandProfile>, kHands>;
Hands hands_of(const profiles::DeviceProfile& profile);

/// What happens first within a bus frame; for devices with interrupt endpoints.
enum class FrameOrder : std::uint8_t {
  kOutFirst,  ///< OUT, firmware, IN: the answer to a report is collected in the same frame
  kInFirst,   ///< IN, OUT, firmware: the answer is collected one frame later
};
/// "out-first" or "in-first". @throws std::invalid_argument for anything else.
FrameOrder parse_frame_order(std::string_view name);

struct DeviceOptions {
  profiles::DeviceProfile profile;
  HandKind hand = HandKind::kFirm;
  bool hand_carries_weight = true;          ///< see ArmModel
  double tip_mass_kg = 0.0;                 ///< fastened to the tip, beside the arm's own
  OperatorScript::Options operator_script;  ///< with `calibrated` the counters also start true
  FrameOrder frame_order = FrameOrder::kOutFirst;
  /// An arm's counters at power-up: false: 0; true: seeded random ones within +-20000. A Falcon's
  /// counters always start at random.
  bool random_power_up_counters = false;
  std::vector<FaultSpec> faults;  ///< the faults to inject, see FaultyDevice
  bool firmware_loaded = false;   ///< Falcon: the firmware runs from the start
  std::string core;               ///< an arm's: see CoreLine; empty: it has no second processor

  /// The numbers for `hand`; nothing for kNone.
  [[nodiscard]] std::optional<profiles::HandProfile> hand_profile() const {
    return hands_of(profile)[static_cast<std::size_t>(hand)];
  }
};

#pragma GCC visibility pop
}  // namespace forcegrid::emulator
