// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_device.h"

#include <chrono>
#include <vector>

#include "driver/discovery.h"
#include "log/log.h"
#include "tools/unit_profile.h"

namespace forcegrid::cli {

std::string calibrated_profile(const RunOptions& options, const std::string& profile_name,
                               const driver::DeviceIdentity& identity,
                               const std::string& lasting_url) {
  if (options.calibration == "none") {
    return "";
  }
  return options.calibration != "auto"
             ? options.calibration
             : tools::find_unit_profile(profile_name, tools::unit_key(identity, lasting_url))
                   .value_or("");
}

std::unique_ptr<driver::Device> open_for_run(const std::string& url,
                                             const profiles::DeviceProfile& profile,
                                             const driver::falcon::Firmware& firmware,
                                             const RunOptions& options, bool realtime) {
  driver::OpenOptions open_options;
  open_options.firmware = firmware;
  open_options.realtime_io = realtime;
  open_options.share = options.share;
  open_options.stale_after = std::chrono::milliseconds(options.device_timeout_ms);
  open_options.notice = [](const std::string& text) { log::info("device", text); };
  try {
    return driver::open_device(url, profile, open_options);
  } catch (const driver::DeviceError& error) {
    if (url.rfind("hid:", 0) != 0 && url.rfind("falcon", 0) != 0) {
      throw;
    }
    std::vector<profiles::DeviceProfile> known;
    for (const std::string& name : profiles::available_profiles()) {
      known.push_back(profiles::load_device_profile(name));
    }
    throw driver::DeviceError(std::string(error.what()) + "\n" +
                              driver::describe_attached_devices(known));
  }
}

}  // namespace forcegrid::cli
