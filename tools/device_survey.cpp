// SPDX-License-Identifier: Apache-2.0
#include "tools/device_survey.h"

#include <grp.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <tuple>

#include "driver/device.h"
#include "driver/hidraw_nodes.h"
#include "driver/node_users.h"
#include "driver/sysfs_file.h"
#include "driver/usbip_list.h"
#include "driver/w2_device.h"
#include "tools/udev_rules.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;
using profiles::DeviceProfile;

constexpr char kGroup[] = "plugdev";
constexpr char kRule[] = "10-forcegrid.rules";
constexpr char kInstallRule[] =
    "sudo cp udev/10-forcegrid.rules /etc/udev/rules.d/ && sudo udevadm control --reload, then "
    "plug "
    "the device in again";
constexpr auto kUsbipTimeout = std::chrono::seconds(2);
constexpr std::uint16_t kUsbipPort = 3240;

std::string padded3(const std::string& number) {
  return number.size() < 3 ? std::string(3 - number.size(), '0') + number : number;
}

std::vector<const DeviceProfile*> profiles_of(const std::vector<DeviceProfile>& known,
                                              std::uint16_t vendor_id, std::uint16_t product_id) {
  std::vector<const DeviceProfile*> matching;
  for (const DeviceProfile& profile : known) {
    if (profile.usb.vendor_id == vendor_id && profile.usb.product_id == product_id) {
      matching.push_back(&profile);
    }
  }
  return matching;
}

// Tests keep the contents of /dev elsewhere.
std::string real_path(const std::string& node, const SurveyRoots& roots) {
  return roots.dev + node.substr(std::strlen("/dev"));
}

std::string owner_words(const struct stat& status) {
  const passwd* const user = getpwuid(status.st_uid);
  const group* const its_group = getgrgid(status.st_gid);
  char mode[8];
  std::snprintf(mode, sizeof mode, "%04o", static_cast<unsigned>(status.st_mode & 07777U));
  return std::string(user != nullptr ? user->pw_name : std::to_string(status.st_uid)) + ":" +
         (its_group != nullptr ? its_group->gr_name : std::to_string(status.st_gid)) + " " + mode;
}

std::string installed_rule(const SurveyRoots& roots) {
  for (const std::string& folder : roots.rule_folders) {
    std::error_code error;
    if (fs::exists(folder + "/" + kRule, error)) {
      return folder + "/" + kRule;
    }
  }
  return "";
}

// The missing step between the user and the node: rule, group, session, or plugging in again.
Obstacle permission_obstacle(const std::string& node, const struct stat& status,
                             const SurveyRoots& roots, const SurveyUser& user) {
  Obstacle obstacle{"permission", true, "", ""};
  obstacle.what =
      node + " is " + owner_words(status) + ", user " + user.name + " may not read and write it; ";
  const std::string rule = installed_rule(roots);
  const bool ruled = user.plugdev == status.st_gid && (status.st_mode & 0060U) == 0060U;
  if (rule.empty()) {
    obstacle.what += std::string("the udev rule ") + kRule + " is not installed";
    obstacle.remedy = kInstallRule;
  } else if (!user.plugdev) {
    obstacle.what += "the rule " + rule + " gives it to group plugdev, which does not exist";
    obstacle.remedy = "sudo groupadd --system plugdev && sudo usermod -aG plugdev " + user.name +
                      ", then log in again and plug the device in again";
  } else if (!ruled) {
    obstacle.what += "the rule " + rule + " was installed after the device was plugged in";
    obstacle.remedy = "sudo udevadm control --reload, then plug the device in again";
  } else if (!user.plugdev_listed) {
    obstacle.what += "the rule gives it to group plugdev, but " + user.name + " is not in it";
    obstacle.remedy = "sudo usermod -aG plugdev " + user.name + ", then log in again";
  } else if (!user.plugdev_active) {
    obstacle.what += user.name + " is in group plugdev, but not yet in this session";
    obstacle.remedy = "log in again (or for this shell: newgrp plugdev)";
  } else {
    obstacle.what +=
        "although the group is right; something else denies access (a container, an ACL)";
    obstacle.remedy = "getfacl " + node + "; in a container pass the device in";
  }
  return obstacle;
}

// Any account may command the motors: which file does that, and can our rule undo it?
Obstacle open_obstacle(const FoundDevice& device, const struct stat& status,
                       const SurveyRoots& roots) {
  const bool hid = device.bus == "hidraw";
  const auto rule =
      rule_that_opens({.subsystem = hid ? "hidraw" : "usb",
                       .kernel = hid ? fs::path(device.node).filename().string() : device.port_path,
                       .vendor_id = device.vendor_id,
                       .product_id = device.product_id},
                      roots.rule_folders);
  Obstacle obstacle{"open to all", false, "", ""};
  obstacle.what = device.node + " is " + owner_words(status) +
                  ": every account of this computer may command its motors; ";
  if (!rule) {
    obstacle.what += "no udev rule does that, so a program or a person did";
    obstacle.remedy = "sudo chmod o-rw " + device.node + ", and find out who did";
    return obstacle;
  }
  const std::string place = rule->file + ":" + std::to_string(rule->line);
  obstacle.what += place + " does that (" + rule->assignment + ")";
  const bool ours_wins =
      rule->assignment.starts_with("MODE") && !(rule->final && rule->before_ours);
  if (!ours_wins) {
    obstacle.remedy =
        "no later rule can undo it: write MODE=\"0660\", GROUP=\"plugdev\", "
        "TAG+=\"uaccess\" there instead, then sudo udevadm control --reload and plug "
        "the device in again";
  } else if (installed_rule(roots).empty()) {
    obstacle.remedy = std::string(kInstallRule) + "; it is final, so that line has no effect then";
  } else {
    obstacle.remedy =
        "sudo make install-udev, then plug the device in again; the rule of this "
        "version is final, so that line has no effect then";
  }
  return obstacle;
}

void look_at_node(FoundDevice& device, const SurveyRoots& roots, const SurveyUser& user) {
  const std::string path = real_path(device.node, roots);
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) {
    device.obstacles.push_back({"no node", true, device.node + " does not exist",
                                "check that udev runs (in a container: pass the node in)"});
    return;
  }
  if (!user.may_open(path)) {
    device.obstacles.push_back(permission_obstacle(device.node, status, roots, user));
  }
  if ((status.st_mode & S_IWOTH) != 0) {
    device.obstacles.push_back(open_obstacle(device, status, roots));
  }
  for (const driver::NodeUser& user_of_it :
       driver::users_of_node(device.node, path, roots.proc).users) {
    const bool drives = user_of_it.locks || device.bus == "usbfs";
    device.obstacles.push_back(
        {"busy", true,
         driver::names_of({user_of_it}) +
             (drives ? " drives it" : " has it open and could send to it at the same time"),
         "end it (" + driver::command_that_ends({user_of_it}) + "), or wait until it ends" +
             (drives ? "" : "; if it only listens, run with --share")});
  }
}

void look_at_power(FoundDevice& device, const fs::path& usb) {
  if (driver::first_line(usb / "power/control") == "auto") {
    device.obstacles.push_back(
        {"autosuspend", false,
         "the kernel may suspend it when idle (power/control is auto), which loses its first "
         "reports and switches its motors off",
         "echo on | sudo tee " + (usb / "power/control").string() +
             " (the udev rule does this whenever the device is plugged in)"});
  }
}

std::string firmware_words(const DeviceProfile& profile) {
  if (profile.usb.protocol == "falcon") {
    return "Falcon (loaded at every power-on)";
  }
  std::string name = profile.usb.protocol;
  for (char& c : name) {
    c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  }
  return name + " (reports of " + std::to_string(profile.usb.report_bytes) + " bytes)";
}

void name_profiles(FoundDevice& device, const std::vector<const DeviceProfile*>& matching) {
  for (const DeviceProfile* profile : matching) {
    device.profiles.push_back(profile->name);
  }
  device.firmware = firmware_words(*matching.front());
}

FoundDevice hid_device(const driver::HidrawNode& node,
                       const std::vector<const DeviceProfile*>& matching, const SurveyRoots& roots,
                       const SurveyUser& user) {
  FoundDevice device;
  device.bus = "hidraw";
  device.node = node.node;
  device.port_path = node.port_path;
  device.vendor_id = node.vendor_id;
  device.product_id = node.product_id;
  device.manufacturer = node.manufacturer;
  device.product = node.product;
  device.serial = node.serial;
  device.url = node.port_path.empty() ? "hid:" + node.node : "hid:path=" + node.port_path;
  name_profiles(device, matching);
  const std::string objection =
      driver::descriptor_objection(node.report_descriptor, *matching.front());
  if (!objection.empty()) {
    const std::size_t remedy = objection.rfind("; ");
    device.obstacles.push_back({"descriptor", true, objection.substr(0, remedy),
                                remedy == std::string::npos ? "" : objection.substr(remedy + 2)});
    device.firmware = objection.find("W1") != std::string::npos ? "W1" : "unknown";
  }
  look_at_node(device, roots, user);
  return device;
}

FoundDevice usb_device(const fs::path& usb, const std::vector<const DeviceProfile*>& matching,
                       const SurveyRoots& roots, const SurveyUser& user) {
  FoundDevice device;
  device.bus = "usbfs";
  device.port_path = usb.filename().string();
  device.node = "/dev/bus/usb/" + padded3(driver::first_line(usb / "busnum")) + "/" +
                padded3(driver::first_line(usb / "devnum"));
  device.vendor_id = matching.front()->usb.vendor_id;
  device.product_id = matching.front()->usb.product_id;
  device.manufacturer = driver::first_line(usb / "manufacturer");
  device.product = driver::first_line(usb / "product");
  device.serial = driver::first_line(usb / "serial");
  name_profiles(device, matching);
  look_at_node(device, roots, user);
  if (matching.front()->usb.protocol == "falcon") {
    device.url = "falcon:path=" + device.port_path;
    return device;
  }
  std::error_code error;
  const fs::path driver = fs::read_symlink(usb / (device.port_path + ":1.0") / "driver", error);
  const std::string who =
      error ? "no kernel driver" : "driver " + driver.filename().string() + ", not usbhid,";
  device.obstacles.push_back(
      {"no node", true, "it has no hidraw node because " + who + " has its interface",
       "end the program that claimed it (a libusb client), or plug it in again; if the module is "
       "missing, sudo modprobe usbhid"});
  return device;
}

// An IPv6 address before a port is in brackets.
std::string without_brackets(const std::string& host) {
  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  return bracketed ? host.substr(1, host.size() - 2) : host;
}

}  // namespace

bool FoundDevice::usable() const {
  return std::none_of(obstacles.begin(), obstacles.end(),
                      [](const Obstacle& obstacle) { return obstacle.blocks; });
}

SurveyUser current_user() {
  SurveyUser user;
  const passwd* const entry = getpwuid(geteuid());
  user.name = entry != nullptr ? entry->pw_name : std::to_string(geteuid());
  user.may_open = [](const std::string& node) { return ::access(node.c_str(), R_OK | W_OK) == 0; };
  const group* const plugdev = getgrnam(kGroup);
  if (plugdev != nullptr) {
    user.plugdev = plugdev->gr_gid;
    for (char** member = plugdev->gr_mem; *member != nullptr; ++member) {
      user.plugdev_listed = user.plugdev_listed || user.name == *member;
    }
    user.plugdev_listed =
        user.plugdev_listed || (entry != nullptr && entry->pw_gid == plugdev->gr_gid);
    std::vector<gid_t> groups(static_cast<std::size_t>(std::max(getgroups(0, nullptr), 0)));
    if (getgroups(static_cast<int>(groups.size()), groups.data()) >= 0) {
      user.plugdev_active = getegid() == *user.plugdev ||
                            std::find(groups.begin(), groups.end(), *user.plugdev) != groups.end();
    }
  }
  return user;
}

std::vector<FoundDevice> survey_devices(const std::vector<DeviceProfile>& known,
                                        const SurveyRoots& roots, const SurveyUser& user) {
  std::vector<driver::HidrawNode> nodes = driver::list_hidraw_nodes(roots.sysfs);
  for (const DeviceProfile& profile : known) {
    if (profile.usb.protocol != "falcon") {
      nodes = driver::without_other_interfaces(std::move(nodes), profile.usb.usage_page,
                                               profile.usb.usage);
    }
  }
  std::vector<FoundDevice> found;
  std::set<std::string> ports_with_node;
  for (const driver::HidrawNode& node : nodes) {
    const auto matching = profiles_of(known, node.vendor_id, node.product_id);
    if (!matching.empty()) {
      found.push_back(hid_device(node, matching, roots, user));
      ports_with_node.insert(node.port_path);
    }
  }
  const fs::path usb_devices = fs::path(roots.sysfs) / "bus/usb/devices";
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(usb_devices, error)) {
    const std::string port = entry.path().filename().string();
    unsigned vendor_id = 0;
    unsigned product_id = 0;
    const std::string ids = driver::first_line(entry.path() / "idVendor") + " " +
                            driver::first_line(entry.path() / "idProduct");
    if (std::sscanf(ids.c_str(), "%x %x", &vendor_id, &product_id) != 2) {
      continue;
    }
    const auto matching = profiles_of(known, static_cast<std::uint16_t>(vendor_id),
                                      static_cast<std::uint16_t>(product_id));
    if (!matching.empty() && !ports_with_node.contains(port)) {
      found.push_back(usb_device(entry.path(), matching, roots, user));
    }
  }
  for (FoundDevice& device : found) {
    if (!device.port_path.empty()) {
      look_at_power(device, usb_devices / device.port_path);
    }
  }
  std::sort(found.begin(), found.end(), [](const FoundDevice& a, const FoundDevice& b) {
    return std::tie(a.port_path, a.node) < std::tie(b.port_path, b.node);
  });
  return found;
}

std::vector<FoundDevice> survey_usbip(const std::vector<DeviceProfile>& known,
                                      const std::string& host_and_port) {
  std::string host = host_and_port;
  std::uint16_t port = kUsbipPort;
  const std::size_t colon = host_and_port.rfind(':');
  const std::size_t bracket = host_and_port.rfind(']');
  const bool has_port =
      colon != std::string::npos &&
      (bracket == std::string::npos ? host_and_port.find(':') == colon : colon == bracket + 1);
  if (has_port) {
    host = host_and_port.substr(0, colon);
    const char* const end = host_and_port.data() + host_and_port.size();
    const auto [stopped, error] = std::from_chars(host_and_port.data() + colon + 1, end, port);
    if (error != std::errc() || stopped != end || port == 0) {
      throw driver::DeviceError("USB/IP server '" + host_and_port +
                                "': the port after the colon must be 1 to 65535; write HOST:PORT");
    }
  }
  std::vector<FoundDevice> found;
  for (const driver::UsbipListing& listing :
       driver::list_usbip_devices(without_brackets(host), port, kUsbipTimeout)) {
    const auto matching = profiles_of(known, listing.vendor_id, listing.product_id);
    if (matching.empty()) {
      continue;
    }
    FoundDevice device;
    device.bus = "usbip";
    device.port_path = listing.bus_id;
    device.vendor_id = listing.vendor_id;
    device.product_id = listing.product_id;
    device.url = "usbip://" + host + ":" + std::to_string(port) + "/" + listing.bus_id;
    name_profiles(device, matching);
    found.push_back(std::move(device));
  }
  return found;
}

}  // namespace forcegrid::tools
