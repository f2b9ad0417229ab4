// SPDX-License-Identifier: Apache-2.0
#include "cli/device/devices_command.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "driver/device.h"
#include "log/log.h"
#include "tools/device_survey.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::FoundDevice;
using tools::Obstacle;

constexpr int kNoneUsable = 3;
constexpr int kNone = 4;
constexpr char kDefaultProfile[] = "woodenhaptics_v2015";

std::string ids(const FoundDevice& device) {
  char text[16];
  std::snprintf(text, sizeof text, "%04x:%04x", device.vendor_id, device.product_id);
  return text;
}

ordered_json json_of(const FoundDevice& device) {
  ordered_json obstacles = ordered_json::array();
  for (const Obstacle& obstacle : device.obstacles) {
    obstacles.push_back({{"kind", obstacle.kind},
                         {"blocks", obstacle.blocks},
                         {"what", obstacle.what},
                         {"remedy", obstacle.remedy}});
  }
  return {{"bus", device.bus},
          {"node", device.node},
          {"port", device.port_path},
          {"ids", ids(device)},
          {"manufacturer", device.manufacturer},
          {"product", device.product},
          {"serial", device.serial},
          {"firmware", device.firmware},
          {"profiles", device.profiles},
          {"url", device.url},
          {"usable", device.usable()},
          {"obstacles", obstacles}};
}

void print(std::FILE* out, const FoundDevice& device) {
  std::fprintf(out, "%s  %s %s %s%s%s\n", ids(device).c_str(),
               device.usable() ? "ready  " : "NOT OK ", device.manufacturer.c_str(),
               device.product.c_str(), device.serial.empty() ? "" : ", serial ",
               device.serial.c_str());
  std::fprintf(out, "           %s%s%s%s%s; firmware %s; profiles %s\n", device.bus.c_str(),
               device.node.empty() ? "" : " ", device.node.c_str(),
               device.port_path.empty() ? "" : " at port ", device.port_path.c_str(),
               device.firmware.c_str(), joined(device.profiles).c_str());
  if (device.usable()) {
    const bool has_default = std::find(device.profiles.begin(), device.profiles.end(),
                                       kDefaultProfile) != device.profiles.end();
    std::fprintf(out, "           use it: forcegrid run --device %s --profile %s\n",
                 device.url.c_str(),
                 has_default ? kDefaultProfile : device.profiles.front().c_str());
  }
  for (const Obstacle& obstacle : device.obstacles) {
    std::fprintf(out, "           %s: %s\n             -> %s\n", obstacle.kind.c_str(),
                 obstacle.what.c_str(), obstacle.remedy.c_str());
  }
}

tools::SurveyRoots roots_below(const std::string& root) {
  tools::SurveyRoots roots;
  for (std::string* path : {&roots.sysfs, &roots.dev, &roots.proc}) {
    *path = root + *path;
  }
  for (std::string& folder : roots.rule_folders) {
    folder = root + folder;
  }
  return roots;
}

}  // namespace

void add_devices(Command& app, DevicesOptions& o, std::function<int()>& action) {
  Command& devices = app.add_subcommand(
      "devices",
      "List haptic devices and, for each that cannot be used, the reason and the remedy");
  devices.add_option("--usbip", o.usbip,
                     "USB/IP servers to ask as well: HOST or HOST:PORT; may be repeated");
  devices
      .add_option("--root", o.root,
                  "Folder before /sys, /dev, /proc and /etc, e.g. of another system's image")
      ->not_in_config();
  devices.footer(
      "Exit status: 0 a device can be used, 3 there are some but none can be, 4 there is none,\n"
      "1 a USB/IP server can't be asked.");
  devices.callback([&o, &action] { action = [&o] { return devices_command(o); }; });
}

int devices_command(const DevicesOptions& options) {
  std::vector<profiles::DeviceProfile> known;
  for (const std::string& name : profiles::available_profiles()) {
    known.push_back(profiles::load_device_profile(name));
  }
  std::vector<FoundDevice> found =
      tools::survey_devices(known, roots_below(options.root), tools::current_user());
  ordered_json failures = ordered_json::array();
  const ResultText text(options.json, "devices");
  std::FILE* const out = text.stream();
  for (const std::string& host : options.usbip) {
    try {
      for (FoundDevice& device : tools::survey_usbip(known, host)) {
        found.push_back(std::move(device));
      }
    } catch (const driver::DeviceError& error) {
      failures.push_back(error.what());
      log::error("device", error.what());
    }
  }
  ordered_json list = ordered_json::array();
  for (const FoundDevice& device : found) {
    print(out, device);
    list.push_back(json_of(device));
  }
  if (found.empty()) {
    std::fprintf(
        out,
        "No haptic device found%s. Plug one in and switch it on, ask another computer with "
        "--usbip HOST,\nor run without one: forcegrid run --device "
        "emulated:woodenhaptics_v2015\n",
        failures.empty() ? "" : " where it could be asked");
  }
  write_json(options.json, ordered_json{{"devices", list}, {"failures", failures}}.dump(2));
  const bool any_usable = std::any_of(found.begin(), found.end(),
                                      [](const FoundDevice& device) { return device.usable(); });
  return !failures.empty() ? 1 : any_usable ? 0 : found.empty() ? kNone : kNoneUsable;
}

}  // namespace forcegrid::cli
