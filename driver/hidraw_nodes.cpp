// SPDX-License-Identifier: Apache-2.0
#include "driver/hidraw_nodes.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>

#include "driver/device.h"
#include "driver/hid_descriptor.h"
#include "driver/sysfs_file.h"

namespace forcegrid::driver {
namespace {

namespace fs = std::filesystem;

/// The value of KEY=value in a uevent file.
std::string uevent_value(const fs::path& path, const std::string& key) {
  std::ifstream stream(path);
  for (std::string line; std::getline(stream, line);) {
    if (line.starts_with(key + "=")) {
      return line.substr(key.size() + 1);
    }
  }
  return "";
}

std::optional<std::uint32_t> hexadecimal(const std::string& text) {
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) {
    return std::nullopt;
  }
  return value;
}

int node_number(const std::string& name) {
  constexpr std::size_t kPrefix = 6;  // "hidraw"
  int number = -1;
  if (name.starts_with("hidraw")) {
    const auto [end, error] =
        std::from_chars(name.data() + kPrefix, name.data() + name.size(), number);
    if (error != std::errc() || end != name.data() + name.size()) {
      return -1;
    }
  }
  return number;
}

std::string hex4(std::uint16_t value) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text(4, '0');
  for (std::size_t i = 0; i < 4; ++i) {
    text[3 - i] = kDigits[(value >> (4 * i)) & 0xF];
  }
  return text;
}

std::string list_of(const std::vector<HidrawNode>& nodes) {
  std::string text;
  for (const HidrawNode& node : nodes) {
    text += "\n  " + describe(node);
  }
  return text;
}

bool matches(const DeviceUrl& url, const HidrawNode& node) {
  switch (url.kind) {
    case DeviceUrl::Kind::kHidId:
      return node.vendor_id == url.vendor_id && node.product_id == url.product_id &&
             (url.serial.empty() || node.serial == url.serial);
    case DeviceUrl::Kind::kHidNode:
      return node.node == url.node;
    case DeviceUrl::Kind::kHidPort:
      return node.port_path == url.port_path;
    case DeviceUrl::Kind::kUsbip:
    case DeviceUrl::Kind::kFalcon:
      return false;
  }
  return false;
}

bool has_usage(const HidrawNode& node, std::uint16_t usage_page, std::uint16_t usage) {
  try {
    const HidInterface interface = parse_hid_descriptor(node.report_descriptor);
    return interface.usage_page == usage_page && interface.usage == usage;
  } catch (const DeviceError&) {
    return false;  // where it is the only node of its device, opening it says what is wrong
  }
}

}  // namespace

std::vector<HidrawNode> list_hidraw_nodes(const std::string& sysfs) {
  std::vector<std::pair<int, HidrawNode>> found;
  std::error_code error;
  for (const fs::directory_entry& entry :
       fs::directory_iterator(fs::path(sysfs) / "class/hidraw", error)) {
    const std::string name = entry.path().filename().string();
    const int number = node_number(name);
    std::error_code link_error;
    const fs::path hid = fs::canonical(entry.path() / "device", link_error);
    if (number < 0 || link_error) {
      continue;
    }
    // HID_ID=0003:00001234:00000006, the bus type first.
    const std::string id = uevent_value(hid / "uevent", "HID_ID");
    const std::size_t first = id.find(':');
    const std::size_t second = id.find(':', first == std::string::npos ? first : first + 1);
    if (second == std::string::npos) {
      continue;
    }
    const auto vendor = hexadecimal(id.substr(first + 1, second - first - 1));
    const auto product = hexadecimal(id.substr(second + 1));
    if (!vendor || !product) {
      continue;
    }
    HidrawNode node;
    node.node = "/dev/" + name;
    node.vendor_id = static_cast<std::uint16_t>(*vendor);
    node.product_id = static_cast<std::uint16_t>(*product);
    node.serial = uevent_value(hid / "uevent", "HID_UNIQ");
    node.product = uevent_value(hid / "uevent", "HID_NAME");
    // .../1-2/1-2:1.0/0003:1234:0006.0001: the HID device hangs below a USB interface, which hangs
    // below the USB device; its folder is named after the port.
    const fs::path usb = hid.parent_path().parent_path();
    if (fs::exists(usb / "idVendor", error)) {
      node.port_path = usb.filename().string();
      node.interface = hid.parent_path().filename().string();
      node.manufacturer = first_line(usb / "manufacturer");
      node.product = first_line(usb / "product");
      node.serial = first_line(usb / "serial");
    }
    std::ifstream stream(hid / "report_descriptor", std::ios::binary);
    node.report_descriptor.assign(std::istreambuf_iterator<char>(stream),
                                  std::istreambuf_iterator<char>());
    found.emplace_back(number, std::move(node));
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<HidrawNode> nodes;
  for (auto& [number, node] : found) {
    nodes.push_back(std::move(node));
  }
  return nodes;
}

HidrawNode select_hidraw_node(const DeviceUrl& url, const std::vector<HidrawNode>& nodes) {
  std::vector<HidrawNode> matching;
  std::copy_if(nodes.begin(), nodes.end(), std::back_inserter(matching),
               [&](const HidrawNode& node) { return matches(url, node); });
  if (matching.empty()) {
    throw DeviceError(
        "device '" + url.text + "': not found; " +
        (nodes.empty() ? "this computer has no HID device at all"
                       : "the HID devices of this computer are:" + list_of(nodes)) +
        "\nCheck the cable and the power of the device, or run without one: emulated:PROFILE");
  }
  if (matching.size() > 1) {
    std::string remedy = "\nName one by its port, e.g. hid:path=" + matching.front().port_path;
    throw DeviceError("device '" + url.text + "': " + std::to_string(matching.size()) +
                      " devices match, which serial numbers can't tell apart:" + list_of(matching) +
                      remedy);
  }
  return matching.front();
}

std::vector<HidrawNode> without_other_interfaces(std::vector<HidrawNode> nodes,
                                                 std::uint16_t usage_page, std::uint16_t usage) {
  std::vector<std::string> ports;
  for (const HidrawNode& node : nodes) {
    if (!node.port_path.empty() && has_usage(node, usage_page, usage)) {
      ports.push_back(node.port_path);
    }
  }
  std::erase_if(nodes, [&](const HidrawNode& node) {
    return std::find(ports.begin(), ports.end(), node.port_path) != ports.end() &&
           !has_usage(node, usage_page, usage);
  });
  return nodes;
}

std::string describe(const HidrawNode& node) {
  return node.node + (node.port_path.empty() ? "" : " at USB port " + node.port_path) + ": " +
         hex4(node.vendor_id) + ":" + hex4(node.product_id) + " " + node.manufacturer + " " +
         node.product + (node.serial.empty() ? "" : ", serial " + node.serial);
}

}  // namespace forcegrid::driver
