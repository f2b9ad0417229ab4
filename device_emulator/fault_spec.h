// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "device_emulator/boot_loader_faults.h"

namespace forcegrid::emulator {
#pragma GCC visibility push(default)

/// What an emulated device can do wrong.
enum class FaultKind : std::uint8_t {
  kDropReport,
  kDuplicateReport,
  kLateReport,
  kShortReport,
  kLongReport,
  kCorruptReport,
  kFrozenEncoder,
  kJumpingEncoder,
  kWrappingEncoder,
  kSaturatedEncoder,
  kStallIn,
  kStallOut,
  kStallControl,
  kNakOut,
  kOverLongPayload,
  kBabble,
  kSlowFirmware,
  kWatchdogTrip,
  kFirmwareReboot,
  kConnectionClosed,
  kWrongWayMotor,
  kMalformedDescriptors,
  kStatusOnly,
  kWrongEcho,
  kStuckBootLoader,
  kCount
};

/// One fault as written on the command line:
///
///   NAME[:KEY=VALUE[,KEY=VALUE]...]      e.g. late-report:ms=50,when=motors,for=2
///
/// Keys of every fault:
///   when=motors    once current has flowed for 0.5 s without a pause (the default of most)
///   when=power-up  from the beginning
///   when=S         S seconds after a host has configured the device for the first time
///   for=S          ends after S seconds (default 0: never)
///   count=N        acts N times at most (default 0: any number)
/// The other keys, and which fault knows which, are in fault_names_text().
struct FaultSpec {
  enum class Start : std::uint8_t { kMotors, kPowerUp, kSeconds };

  FaultKind kind = FaultKind::kDropReport;
  Start start = Start::kMotors;
  double start_s = 0.0;           ///< kSeconds: after the first configuration
  double duration_s = 0.0;        ///< 0: without end
  std::uint64_t count = 0;        ///< 0: any number of times
  std::uint64_t every = 1;        ///< acts on every n-th report
  double probability = 1.0;       ///< and then with this probability
  std::optional<int> axis;        ///< 0 to 5 for a to f; nothing: a, b and c
  double milliseconds = 0.0;      ///< delay, pause or absence
  std::size_t bytes = 0;          ///< length of a report
  std::int32_t counts = 0;        ///< size of a jump [encoder counts]
  int bits = 16;                  ///< width of a counter
  bool small_corruption = false;  ///< only the lowest bits of counters
  std::uint64_t image_byte = 0;   ///< of the firmware image being loaded, from 0
  BootStep boot_step = BootStep::kStart;
  std::uint64_t seed = 1;  ///< of everything random
};

/// "drop-report" and so on.
const char* name_of(FaultKind kind) noexcept;

/// @throws std::invalid_argument naming the wrong part and the known ones.
FaultSpec parse_fault(std::string_view text);

/// For --help: every fault with its own keys and their defaults, one per line.
std::string fault_names_text();

#pragma GCC visibility pop
}  // namespace forcegrid::emulator
