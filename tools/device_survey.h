#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid::tools {

/// Where the system keeps what a survey reads; tests have their own.
struct SurveyRoots {
  std::string sysfs = "/sys";
  std::string dev = "/dev";
  std::string proc = "/proc";
  std::vector<std::string> rule_folders = {"/etc/udev/rules.d", "/run/udev/rules.d",
                                           "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d",
                                           "/lib/udev/rules.d"};
};

/// On whose behalf the survey asks.
struct SurveyUser {
  std::string name;
  std::optional<gid_t> plugdev;  ///< nothing: there is no such group
  bool plugdev_listed = false;   ///< among its members
  bool plugdev_active = false;   ///< and so in this session
  std::function<bool(const std::string& node)> may_open;
};

/// The user of this process.
SurveyUser current_user();

/// What is in the way of a device, or will be.
struct Obstacle {
  std::string kind;    ///< "permission", "busy", "descriptor", "no node", "autosuspend"
  bool blocks = true;  ///< false: it works, but not for long or not alone
  std::string what;
  std::string remedy;  ///< a command where there is one
};

/// A device that could be one of ours, by its USB numbers.
struct FoundDevice {
  std::string bus;        ///< "hidraw", "usbfs", "usbip"
  std::string node;       ///< "/dev/hidraw3", "/dev/bus/usb/001/004"; empty: none
  std::string port_path;  ///< "1-2"; of USB/IP the bus id; empty: no USB device
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string manufacturer, product, serial;
  std::string firmware;               ///< which variant, as far as can be told without opening it
  std::vector<std::string> profiles;  ///< that have its numbers
  std::string url;                    ///< for --device
  std::vector<Obstacle> obstacles;

  bool usable() const;
};

/// Every attached device that has the USB numbers of one of `known`, by port. Nothing is opened.
/// Real-time: no. Threads: any.
std::vector<FoundDevice> survey_devices(const std::vector<profiles::DeviceProfile>& known,
                                        const SurveyRoots& roots, const SurveyUser& user);

/// The same of a USB/IP server, HOST or HOST:PORT (3240).
/// @throws driver::DeviceError when it can't be asked, or for an impossible port.
std::vector<FoundDevice> survey_usbip(const std::vector<profiles::DeviceProfile>& known,
                                      const std::string& host_and_port);

}  // namespace forcegrid::tools
