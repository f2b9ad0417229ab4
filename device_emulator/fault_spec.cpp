// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/fault_spec.h"

#include <array>
#include <charconv>
#include <cmath>
#include <stdexcept>

namespace forcegrid::emulator {

namespace {

constexpr double kLongest_s = 86400.0;

struct Row {
  FaultKind kind;
  const char* name;
  const char* keys;  // in addition to those of every fault, with their defaults
  const char* what;
};

constexpr std::array<Row, static_cast<std::size_t>(FaultKind::kCount)> kRows = {{
    {FaultKind::kDropReport, "drop-report", "every=100 probability=1 seed=1",
     "reports get lost on their way to the host"},
    {FaultKind::kDuplicateReport, "duplicate-report", "every=20 probability=1 seed=1",
     "reports arrive twice"},
    {FaultKind::kLateReport, "late-report", "ms=5 every=1 probability=1 seed=1",
     "reports arrive ms later"},
    {FaultKind::kShortReport, "short-report", "bytes=7 every=1 probability=1 seed=1",
     "reports are cut to this length"},
    {FaultKind::kLongReport, "long-report", "bytes=20 every=1 probability=1 seed=1",
     "reports are padded to this length, at most 64"},
    {FaultKind::kCorruptReport, "corrupt-report", "size=large every=1 probability=1 seed=1",
     "large: bytes of the counters are random; small: their lowest two bits are"},
    {FaultKind::kFrozenEncoder, "frozen-encoder", "axis=all", "counters stand still"},
    {FaultKind::kJumpingEncoder, "jumping-encoder", "axis=c counts=1000 every=1",
     "a counter is wrong by this much, in every n-th report; 1: it jumps once and stays there"},
    {FaultKind::kWrappingEncoder, "wrapping-encoder", "axis=c bits=16",
     "a counter has this many bits and wraps around where it was; 16 is normal"},
    {FaultKind::kSaturatedEncoder, "saturated-encoder", "axis=c", "a counter reads 32767"},
    {FaultKind::kStallIn, "stall-in", "", "the IN endpoint answers STALL"},
    {FaultKind::kStallOut, "stall-out", "", "the OUT endpoint answers STALL"},
    {FaultKind::kStallControl, "stall-control", "when=power-up", "endpoint 0 answers STALL"},
    {FaultKind::kNakOut, "nak-out", "", "the OUT endpoint answers NAK"},
    {FaultKind::kOverLongPayload, "over-long-payload", "",
     "the server's answer carries more bytes than were asked for"},
    {FaultKind::kBabble, "babble", "", "the device sends a packet beyond the host's buffer"},
    {FaultKind::kSlowFirmware, "slow-firmware", "ms=20",
     "after each report that it takes the firmware is busy for ms"},
    {FaultKind::kWatchdogTrip, "watchdog-trip", "",
     "the firmware goes on but does not count reports as signs of life, so its watchdog trips"},
    {FaultKind::kFirmwareReboot, "firmware-reboot", "ms=1500 count=1",
     "power is gone, and back after ms: counters are lost, the connection is closed"},
    {FaultKind::kConnectionClosed, "connection-closed", "ms=1000 count=1",
     "the connection is closed, and taken again after ms; counters survive"},
    {FaultKind::kWrongWayMotor, "wrong-way-motor", "axis=all when=power-up",
     "motors push the other way"},
    {FaultKind::kMalformedDescriptors, "malformed-descriptors", "seed=1 when=power-up",
     "descriptors are mutated, in another way at each attachment"},
    {FaultKind::kStatusOnly, "status-only", "when=power-up",
     "the serial chip sends its status, and nothing of what it gets from the firmware"},
    {FaultKind::kWrongEcho, "wrong-echo", "at=20 when=power-up",
     "the boot loader returns byte AT of the image with its lowest bit turned"},
    {FaultKind::kStuckBootLoader, "stuck-boot-loader", "step=start when=power-up",
     "the boot loader does not answer its greeting, does not return the character of the "
     "baud-rate, "
     "or takes the image and does not start it (greeting, baud-rate, start)"},
}};

const Row& row_of(FaultKind kind) { return kRows[static_cast<std::size_t>(kind)]; }

/// Calls `take(key, value)` for each pair in "a=1 b=2" (or with commas).
template <typename Take>
void for_each_pair(std::string_view text, char separator, const std::string& whole, Take take) {
  while (!text.empty()) {
    const std::string_view pair = text.substr(0, text.find(separator));
    text.remove_prefix(std::min(text.size(), pair.size() + 1));
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos || equals == 0) {
      throw std::invalid_argument("fault '" + whole + "': '" + std::string(pair) +
                                  "' is not KEY=VALUE");
    }
    take(pair.substr(0, equals), pair.substr(equals + 1));
  }
}

bool knows(const Row& row, std::string_view key) {
  if (key == "when" || key == "for" || key == "count") {
    return true;
  }
  bool found = false;
  for_each_pair(row.keys, ' ', row.name,
                [&](std::string_view known, std::string_view) { found = found || known == key; });
  return found;
}

[[noreturn]] void refuse(const std::string& whole, std::string_view key, std::string_view value,
                         const std::string& wanted) {
  throw std::invalid_argument("fault '" + whole + "': " + std::string(key) + "=" +
                              std::string(value) + " is wrong; use " + wanted);
}

double number(const std::string& whole, std::string_view key, std::string_view value, double low,
              double high, const std::string& wanted) {
  double result = 0.0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result);
  if (error != std::errc{} || end != value.data() + value.size() ||
      !(result >= low && result <= high)) {
    refuse(whole, key, value, wanted);
  }
  return result;
}

std::uint64_t whole_number(const std::string& whole, std::string_view key, std::string_view value,
                           std::uint64_t low, std::uint64_t high) {
  std::uint64_t result = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result);
  if (error != std::errc{} || end != value.data() + value.size() || result < low || result > high) {
    refuse(whole, key, value,
           "a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  }
  return result;
}

void set(FaultSpec& spec, const std::string& whole, std::string_view key, std::string_view value) {
  const bool may_be_zero = spec.kind != FaultKind::kLateReport;
  if (key == "when") {
    if (value == "motors") {
      spec.start = FaultSpec::Start::kMotors;
    } else if (value == "power-up") {
      spec.start = FaultSpec::Start::kPowerUp;
    } else {
      spec.start = FaultSpec::Start::kSeconds;
      spec.start_s = number(whole, key, value, 0.0, kLongest_s, "motors, power-up or seconds");
    }
  } else if (key == "for") {
    spec.duration_s =
        number(whole, key, value, 0.0, kLongest_s, "seconds from 0 (without end) to 86400");
  } else if (key == "count") {
    spec.count = whole_number(whole, key, value, 0, UINT64_MAX);
  } else if (key == "every") {
    spec.every = whole_number(whole, key, value, 1, 1'000'000);
  } else if (key == "probability") {
    spec.probability = number(whole, key, value, 0.0, 1.0, "a number from 0 to 1");
  } else if (key == "seed") {
    spec.seed = whole_number(whole, key, value, 0, UINT64_MAX);
  } else if (key == "axis") {
    if (value == "all") {
      spec.axis.reset();
    } else if (value.size() == 1 && value >= "a" && value <= "f") {
      spec.axis = value.front() - 'a';
    } else {
      refuse(whole, key, value, "a, b, c, for a wrist d, e, f, or all of a, b, c");
    }
  } else if (key == "ms") {
    spec.milliseconds =
        number(whole, key, value, may_be_zero ? 0.0 : 0.1, 60'000.0, "milliseconds, at most 60000");
  } else if (key == "bytes") {
    spec.bytes = whole_number(whole, key, value, 0, 64);
  } else if (key == "counts") {
    spec.counts = static_cast<std::int32_t>(whole_number(whole, key, value, 1, 32767));
  } else if (key == "bits") {
    spec.bits = static_cast<int>(whole_number(whole, key, value, 4, 16));
  } else if (key == "at") {
    spec.image_byte = whole_number(whole, key, value, 0, 1'000'000);
  } else if (key == "step") {
    if (value == "greeting") {
      spec.boot_step = BootStep::kGreeting;
    } else if (value == "baud-rate") {
      spec.boot_step = BootStep::kBaudRate;
    } else if (value == "start") {
      spec.boot_step = BootStep::kStart;
    } else {
      refuse(whole, key, value, "greeting, baud-rate or start");
    }
  } else if (key == "size") {
    if (value != "small" && value != "large") {
      refuse(whole, key, value, "small or large");
    }
    spec.small_corruption = value == "small";
  }
}

}  // namespace

const char* name_of(FaultKind kind) noexcept {
  return kind < FaultKind::kCount ? row_of(kind).name : "unknown";
}

FaultSpec parse_fault(std::string_view text) {
  const std::string whole(text);
  const std::size_t colon = text.find(':');
  const std::string_view name = text.substr(0, colon);
  const Row* row = nullptr;
  for (const Row& candidate : kRows) {
    if (name == candidate.name) {
      row = &candidate;
    }
  }
  if (row == nullptr) {
    throw std::invalid_argument("fault '" + std::string(name) + "' is unknown; the faults are:\n" +
                                fault_names_text());
  }
  FaultSpec spec;
  spec.kind = row->kind;
  for_each_pair(row->keys, ' ', row->name, [&](std::string_view key, std::string_view value) {
    set(spec, row->name, key, value);
  });
  const std::string_view options = colon == std::string_view::npos ? "" : text.substr(colon + 1);
  if (colon != std::string_view::npos && options.empty()) {
    throw std::invalid_argument("fault '" + whole + "': nothing follows the colon");
  }
  for_each_pair(options, ',', whole, [&](std::string_view key, std::string_view value) {
    if (!knows(*row, key)) {
      throw std::invalid_argument("fault '" + whole + "': " + row->name + " has no key '" +
                                  std::string(key) + "'; it has when, for, count" +
                                  (*row->keys != '\0' ? " and " : "") + row->keys);
    }
    set(spec, whole, key, value);
  });
  return spec;
}

std::string fault_names_text() {
  std::string text;
  for (const Row& row : kRows) {
    text += std::string("  ") + row.name + (*row.keys != '\0' ? " [" : "") + row.keys +
            (*row.keys != '\0' ? "]" : "") + ": " + row.what + "\n";
  }
  return text;
}

}  // namespace forcegrid::emulator
