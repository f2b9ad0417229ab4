#pragma once

#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::tools {

/// A calibrated profile that can't be found, read or written; names file and remedy.
class UnitProfileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What tells one unit of a kind of device from another, fit for a file's name: "serial-FT000001".
/// W2 boards share one serial number, which mbed's library gives to all of them: such a unit goes
/// by its USB port, "port-1-2", or on a USB/IP server by "usbip-HOST-BUSID"; an emulated device of
/// this program's own by "emulated".
/// @param lasting_url  of driver::lasting_url(); "emulated" for an emulated device.
std::string unit_key(const driver::DeviceIdentity& identity, const std::string& lasting_url);

/// Where a unit's profile is written: $XDG_CONFIG_HOME/forcegrid/devices/NAME@KEY.toml
/// ($HOME/.config where that is unset), NAME that of the profile it was calibrated from.
/// @throws UnitProfileError without a home.
std::string unit_profile_file(const std::string& profile_name, const std::string& key);

/// The unit's calibrated profile: the user's, else that in /etc/forcegrid/devices. Nothing when
/// there is none. Real-time: no. Threads: any.
std::optional<std::string> find_unit_profile(const std::string& profile_name,
                                             const std::string& key);

/// Writes the profile in the file `base` with other values, all else in it and its comments kept.
/// The file appears whole or not at all, also when the power fails, and is one that
/// profiles::load_device_profile() takes; the one before is kept as FILE.old.
/// @param heading  a comment of one line that goes before it.
/// @param changes  keys as "motors.torque_constant_Nm_per_A", values as TOML writes them.
/// @throws UnitProfileError naming file and reason; the old file is as it was then.
void write_unit_profile(const std::string& file, const std::string& base,
                        const std::string& heading,
                        const std::vector<std::pair<std::string, std::string>>& changes);

}  // namespace forcegrid::tools
