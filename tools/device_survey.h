// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid::tools {

/// Folders of the system that a survey reads; tests supply their own.
struct SurveyRoots {
  std::string sysfs = "/sys";
  std::string dev = "/dev";
  std::string proc = "/proc";
  std::vector<std::string> rule_folders = {"/etc/udev/rules.d", "/run/udev/rules.d",
                                           "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d",
                                           "/lib/udev/rules.d"};
};

/// The user whose access the survey checks.
struct SurveyUser {
  std::string name;
  std::optional<gid_t> plugdev;  ///< empty: the group does not exist
  bool plugdev_listed = false;   ///< the user is a member of the group
  bool plugdev_active = false;   ///< the membership is active in this session
  std::function<bool(const std::string& node)> may_open;
};

/// Returns the user of this process.
SurveyUser current_user();

/// A reason why a device can't be used, or may fail in use.
struct Obstacle {
  std::string kind;    ///< "permission", "busy", "descriptor", "no node", "autosuspend",
                       ///< "open to all"
  bool blocks = true;  ///< false: the device works, but may fail or is shared
  std::string what;
  std::string remedy;  ///< a command if there is one
};

/// A device whose USB numbers match a profile.
struct FoundDevice {
  std::string bus;        ///< "hidraw", "usbfs", "usbip"
  std::string node;       ///< "/dev/hidraw3", "/dev/bus/usb/001/004"; empty: none
  std::string port_path;  ///< "1-2"; of USB/IP the bus id; empty: no USB device
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string manufacturer, product, serial;
  std::string firmware;               ///< variant, as far as it shows without opening the device
  std::vector<std::string> profiles;  ///< with its USB numbers
  std::string url;                    ///< for --device
  std::vector<Obstacle> obstacles;

  bool usable() const;
};

/// Returns every attached device that has the USB numbers of one of `known`, sorted by port. Opens
/// no device.
/// Real-time: no. Threads: any.
std::vector<FoundDevice> survey_devices(const std::vector<profiles::DeviceProfile>& known,
                                        const SurveyRoots& roots, const SurveyUser& user);

/// Returns the same for a USB/IP server, HOST or HOST:PORT (default 3240).
/// @throws driver::DeviceError if the server can't be queried, or for an invalid port.
std::vector<FoundDevice> survey_usbip(const std::vector<profiles::DeviceProfile>& known,
                                      const std::string& host_and_port);

}  // namespace forcegrid::tools
