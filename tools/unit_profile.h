// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "driver/device.h"
#include "profiles/device_profile.h"

namespace forcegrid::tools {

/// A calibrated profile can't be found, read or written. what() names file and remedy.
class UnitProfileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Returns a key that identifies one unit of a kind of device and is valid in a file name:
/// "serial-FT000001". W2 boards all share one serial number, set by mbed's library, so their key is
/// the USB port, "port-1-2", or on a USB/IP server "usbip-HOST-BUSID". The key of an emulated
/// device that this program starts is "emulated".
/// @param lasting_url  of driver::lasting_url(); "emulated" for an emulated device.
std::string unit_key(const driver::DeviceIdentity& identity, const std::string& lasting_url);

/// Returns the file of a unit's profile: $XDG_CONFIG_HOME/forcegrid/devices/NAME@KEY.toml
/// ($HOME/.config if that variable is unset). NAME is the profile that the unit was calibrated
/// from.
/// @throws UnitProfileError if neither variable is set.
std::string unit_profile_file(const std::string& profile_name, const std::string& key);

/// Returns the file of the unit's calibrated profile: the user's, else the one in
/// /etc/forcegrid/devices; nothing if there is none. Real-time: no. Threads: any.
std::optional<std::string> find_unit_profile(const std::string& profile_name,
                                             const std::string& key);

/// Writes a copy of the profile `base` with changed values and keeps its other values and comments.
/// Checks the new file with profiles::load_device_profile(), then replaces `file` as by
/// replace_file(); the previous content remains as FILE.old.
/// @param heading a one-line comment at the top of the file.
/// @param changes keys such as "motors.torque_constant_Nm_per_A", with values in TOML syntax.
/// @throws UnitProfileError naming file and reason; the old file is then unchanged.
void write_unit_profile(const std::string& file, const std::string& base,
                        const std::string& heading,
                        const std::vector<std::pair<std::string, std::string>>& changes);

}  // namespace forcegrid::tools
