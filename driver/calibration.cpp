// SPDX-License-Identifier: Apache-2.0
#include "driver/calibration.h"

#include <thread>

#include "driver/falcon_codec.h"
#include "driver/falcon_device.h"

namespace forcegrid::driver {
namespace {

constexpr rt::Duration kPoll = std::chrono::milliseconds(2);
// Farther from zero than a held arm may have moved, see kCounterTolerance.
constexpr std::int16_t kWristProbe_counts = 1000;

/// Waits until `done()`.
/// @returns false when `cancelled` says so, or true.
/// @throws DeviceError when the device fails, or at the deadline with what `late()` says.
bool wait_for_person(Device& device, rt::Duration timeout, const std::function<bool()>& cancelled,
                     const std::function<bool()>& done, const std::function<std::string()>& late) {
  const rt::TimePoint deadline = rt::Clock::now() + timeout;
  while (!done()) {
    if (device.health() != DeviceHealth::kRunning) {
      throw DeviceError(device.failure());
    }
    if (cancelled && cancelled()) {
      return false;
    }
    if (rt::Clock::now() > deadline) {
      throw DeviceError("device '" + device.identity().url + "': " + late());
    }
    std::this_thread::sleep_for(kPoll);
  }
  return true;
}

bool home(Device& device, const std::string& instruction, rt::Duration timeout,
          const std::function<void(const std::string&)>& on_prompt,
          const std::function<bool()>& cancelled) {
  const auto homed = [&] { return device.newest_report().homed == falcon::kAllHomed; };
  if (on_prompt && !homed()) {
    on_prompt(instruction);
  }
  return wait_for_person(device, timeout, cancelled, homed, [&] {
    return "axis " + falcon_axes_not_homed(device.newest_report().homed) +
           " was not homed in time; " + instruction;
  });
}

}  // namespace

bool calibrate(Device& device, const profiles::DeviceProfile& profile, rt::Duration timeout,
               const std::function<void(const std::string&)>& on_prompt,
               const std::function<bool()>& cancelled) {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return home(device, profile.falcon.homing_instruction, timeout, on_prompt, cancelled);
  }
  if (on_prompt) {
    on_prompt(profile.calibration.instruction);
  }
  const bool pressed = wait_for_person(
      device, timeout, cancelled, [&] { return device.newest_report().calibration_button; },
      [&] {
        return "the calibration button was not pressed in time; " + profile.calibration.instruction;
      });
  if (!pressed) {
    return false;
  }
  calibrate_now(device, profile);
  return true;
}

void calibrate_now(Device& device, const profiles::DeviceProfile& profile) {
  std::array<std::int16_t, 6> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] = static_cast<std::int16_t>(profile.calibration.pose_counts[i]);
  }
  if (profiles::has_wrist(profile)) {
    // A device without encoders there reports zeros whatever it is told, and zeros may be right.
    device.load_counters({counts[0], counts[1], counts[2], kWristProbe_counts, kWristProbe_counts,
                          kWristProbe_counts});
  }
  device.load_counters(counts);
}

}  // namespace forcegrid::driver
