// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/device_table.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "driver/device_url.h"
#include "driver/hidraw_nodes.h"
#include "profiles/device_profile.h"
#include "text/text.h"
#include "text/toml_parser.h"
#include "text/toml_table.h"

namespace forcegrid::openhaptics {
namespace {

constexpr char kSystemFile[] = "/etc/forcegrid/openhaptics.toml";
constexpr const char* kDefaultNames[] = {"", "Default Device", "Default PHANToM",
                                         "Default PHANTOM"};
constexpr text::NumberRange kOrigin_mm{-1000.0, 1000.0, "a length in mm from -1000 to 1000"};
constexpr text::NumberRange kHold_ms{1.0, 500.0, "a time in ms from 1 to 500"};

std::string variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::string configuration_file() {
  std::string folder = variable("XDG_CONFIG_HOME");
  if (folder.empty() || folder[0] != '/') {
    folder = variable("HOME") + "/.config";
  }
  const std::string own = folder + "/forcegrid/openhaptics.toml";
  for (const std::string& file : {own, std::string(kSystemFile)}) {
    if (access(file.c_str(), F_OK) == 0) {
      return file;
    }
  }
  return "";
}

DeviceEntry entry_of(const text::TomlTable& table, const std::string& name) {
  DeviceEntry entry;
  entry.name = name;
  entry.url = table.text("url");
  entry.profile = table.text_or("profile", "");
  entry.model = table.text_or("model", "");
  if (entry.model.size() > 254) {
    table.refuse("model", "longer than 254 bytes", "write a shorter one");
  }
  entry.origin_mm = table.axes_or("origin_mm", kOrigin_mm, {});
  entry.calibrated = table.flag_or("calibrated", false);
  entry.falcon_firmware = table.text_or("falcon_firmware", "");
  entry.calibrate_on_update = table.flag_or("calibrate_on_update", false);
  return entry;
}

void read_file(const toml::table& root, const std::string& file, DeviceTable& result) {
  const text::TomlTable whole(root, file, "", {"default", "device", "hold_ms"});
  result.hold_s = 1e-3 * whole.number_or("hold_ms", kHold_ms, 1e3 * result.hold_s);
  const toml::table* const devices = root["device"].as_table();
  if (devices == nullptr) {
    whole.refuse("device", "no table [device.NAME]", "write one with url = \"...\"");
  }
  std::vector<std::string> names;
  for (const auto& [name, node] : *devices) {
    names.emplace_back(name.str());
  }
  // toml++ sorts tables by name; the file's order decides.
  std::stable_sort(names.begin(), names.end(), [&](const std::string& a, const std::string& b) {
    return devices->get(a)->source().begin.line < devices->get(b)->source().begin.line;
  });
  const text::TomlTable all = whole.table("device", names);
  for (const std::string& name : names) {
    result.devices.push_back(
        entry_of(all.table(name.c_str(), {"url", "profile", "model", "origin_mm", "calibrated",
                                          "falcon_firmware", "calibrate_on_update"}),
                 name));
  }
  const std::string first = whole.text_or("default", result.devices.front().name);
  const auto found = std::find_if(result.devices.begin(), result.devices.end(),
                                  [&](const DeviceEntry& one) { return one.name == first; });
  if (found == result.devices.end()) {
    whole.refuse("default", "no device '" + first + "'", "write one of: " + text::joined(names));
  }
  std::rotate(result.devices.begin(), found, found + 1);
}

void put_first(const std::string& device, DeviceTable& table) {
  if (device.empty()) {
    return;
  }
  const auto named = std::find_if(table.devices.begin(), table.devices.end(),
                                  [&](const DeviceEntry& one) { return one.name == device; });
  if (named != table.devices.end()) {
    std::rotate(table.devices.begin(), named, named + 1);
  } else {
    table.devices.insert(table.devices.begin(), DeviceEntry{.url = device});
  }
}

bool speaks_hid(const profiles::DeviceProfile& profile) { return !is_delta(profile); }

// Devices that are attached and known, the first of several profiles with the same numbers being
// the driver's own choice.
std::vector<DeviceEntry> attached_devices() {
  std::vector<DeviceEntry> found;
  std::vector<profiles::DeviceProfile> known;
  for (const std::string& name : profiles::available_profiles()) {
    known.push_back(profiles::load_device_profile(name));
  }
  for (const driver::HidrawNode& node : driver::list_hidraw_nodes()) {
    const bool is_known =
        std::any_of(known.begin(), known.end(), [&](const profiles::DeviceProfile& one) {
          return speaks_hid(one) && one.usb.vendor_id == node.vendor_id &&
                 one.usb.product_id == node.product_id;
        });
    if (is_known) {
      found.push_back({.name = "hid:" + node.node, .url = "hid:" + node.node});
    }
  }
  return found;
}

bool falcon_is_attached() {
  const profiles::DeviceProfile falcon = profiles::load_device_profile("falcon");
  std::error_code ignored;
  for (const auto& folder : std::filesystem::directory_iterator("/sys/bus/usb/devices", ignored)) {
    unsigned vendor = 0;
    unsigned product = 0;
    std::ifstream(folder.path() / "idVendor") >> std::hex >> vendor;
    std::ifstream(folder.path() / "idProduct") >> std::hex >> product;
    if (vendor == falcon.usb.vendor_id && product == falcon.usb.product_id) {
      return true;
    }
  }
  return false;
}

}  // namespace

const DeviceEntry* DeviceTable::find(const char* name) const {
  const std::string wanted = name == nullptr ? "" : name;
  for (const DeviceEntry& one : devices) {
    if (!one.name.empty() && one.name == wanted) {
      return &one;
    }
  }
  const bool is_default = std::find(std::begin(kDefaultNames), std::end(kDefaultNames), wanted) !=
                          std::end(kDefaultNames);
  return is_default && !devices.empty() ? &devices.front() : nullptr;
}

DeviceTable read_device_table(const std::string& file, const std::string& device) {
  DeviceTable result;
  try {
    if (!file.empty()) {
      read_file(text::read_toml_file(file), file, result);
    }
  } catch (const text::TomlError& error) {
    throw DeviceTableError(error.what());
  }
  put_first(device, result);
  return result;
}

DeviceTable load_device_table() {
  DeviceTable result = read_device_table(configuration_file(), variable("FORCEGRID_DEVICE"));
  if (result.devices.empty()) {
    result.devices = attached_devices();
    if (falcon_is_attached()) {
      result.devices.push_back({.name = "falcon", .url = "falcon", .profile = "falcon"});
    }
  }
  return result;
}

bool may_be_present(const DeviceEntry& entry) {
  if (entry.url.starts_with("emulated:")) {
    return true;
  }
  try {
    const driver::DeviceUrl url = driver::parse_device_url(entry.url);
    switch (url.kind) {
      case driver::DeviceUrl::Kind::kUsbip:
        return true;
      case driver::DeviceUrl::Kind::kFalcon:
        return falcon_is_attached();
      default:
        driver::select_hidraw_node(url, driver::list_hidraw_nodes());
        return true;
    }
  } catch (const std::exception&) {
    return false;
  }
}

}  // namespace forcegrid::openhaptics
