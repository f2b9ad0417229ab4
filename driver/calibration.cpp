#include "driver/calibration.h"

#include <thread>

namespace forcegrid::driver {

bool calibrate(Device& device, const profiles::DeviceProfile& profile, rt::Duration timeout,
               const std::function<void(const std::string&)>& on_prompt,
               const std::function<bool()>& cancelled) {
  const rt::TimePoint deadline = rt::Clock::now() + timeout;
  if (on_prompt) {
    on_prompt(profile.calibration.instruction);
  }
  while (!device.newest_report().calibration_button) {
    if (device.health() != DeviceHealth::kRunning) {
      throw DeviceError(device.failure());
    }
    if (cancelled && cancelled()) {
      return false;
    }
    if (rt::Clock::now() > deadline) {
      throw DeviceError("device '" + device.identity().url +
                        "': the calibration button was not pressed in time; " +
                        profile.calibration.instruction);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  calibrate_now(device, profile);
  return true;
}

void calibrate_now(Device& device, const profiles::DeviceProfile& profile) {
  std::array<std::int16_t, 6> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] = static_cast<std::int16_t>(profile.calibration.pose_counts[i]);
  }
  device.load_counters(counts);
}

}  // namespace forcegrid::driver
