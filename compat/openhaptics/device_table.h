// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <stdexcept>
#include <string>
#include <vector>

namespace forcegrid::openhaptics {

/// One device that a program may open.
struct DeviceEntry {
  std::string name{};     ///< as the program says it; empty: only the default
  std::string url{};      ///< as SessionOptions::device
  std::string profile{};  ///< as SessionOptions::profile
  std::string model{};    ///< HD_DEVICE_MODEL_TYPE; empty: the profile's name
  /// [mm] HD's origin, in HD's axes from the profile's origin.
  std::array<double, 3> origin_mm{};
  bool calibrated = false;        ///< as SessionOptions::calibrated
  std::string falcon_firmware{};  ///< as SessionOptions::falcon_firmware
  /// hdUpdateCalibration() takes the arm's pose for its calibration pose.
  bool calibrate_on_update = false;
};

/// The configuration is wrong. what() names file, line, key and remedy.
class DeviceTableError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct DeviceTable {
  std::vector<DeviceEntry> devices;  ///< the default first
  double hold_s = 0.1;               ///< a force is held that long after it was set

  /// What a program's name means: one of `devices`, else null. Exact names come first. No name,
  /// "", "Default Device", "Default PHANToM" and "Default PHANTOM" are the first device.
  [[nodiscard]] const DeviceEntry* find(const char* name) const;
};

/// The devices of this computer, the default first:
///   - $FORCEGRID_DEVICE, a URL or one of the names below, is the default if it is set;
///   - the tables [device.NAME] of openhaptics.toml, in their order;
///   - without any of these, the attached devices.
/// The file is $XDG_CONFIG_HOME/forcegrid/openhaptics.toml ($HOME/.config if that is unset), else
/// /etc/forcegrid/openhaptics.toml.
/// @throws DeviceTableError for a file that can't be used.
/// Real-time: no. Threads: any.
DeviceTable load_device_table();

/// The first two of these alone.
/// @param file   empty: none. @param device  what FORCEGRID_DEVICE says; may be empty.
DeviceTable read_device_table(const std::string& file, const std::string& device);

/// Whether opening it may succeed: an emulated device, one on a server, or one that is attached.
bool may_be_present(const DeviceEntry& entry);

}  // namespace forcegrid::openhaptics
