// SPDX-License-Identifier: Apache-2.0
#include "driver/device_url.h"

#include <algorithm>
#include <charconv>
#include <string_view>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

constexpr std::size_t kLongestBusId = 31;  // the protocol's field has 32 with its end

[[noreturn]] void fail(const std::string& text, const std::string& problem) {
  throw DeviceError("device '" + text + "': " + problem + "; write one of:\n" + device_url_forms());
}

std::string quoted(std::string_view part) {
  std::string text(1, '\'');
  text.append(part).append(1, '\'');
  return text;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::uint16_t parse_id(const std::string& text, std::string_view part, const char* name) {
  std::uint16_t value = 0;
  const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value, 16);
  if (part.size() != 4 || error != std::errc() || end != part.data() + part.size()) {
    fail(text, std::string(name) + " " + quoted(part) + " is not four hexadecimal digits");
  }
  return value;
}

/// "1-2" or "1-2.4.1": bus, dash, ports.
bool is_port_path(std::string_view path) {
  const std::size_t dash = path.find('-');
  if (dash == std::string_view::npos || dash == 0 || dash + 1 == path.size() ||
      path.size() > kLongestBusId || !is_digit(path.back()) || !is_digit(path[dash + 1]) ||
      path.find("..") != std::string_view::npos) {
    return false;
  }
  return std::all_of(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(dash), is_digit) &&
         std::all_of(path.begin() + static_cast<std::ptrdiff_t>(dash) + 1, path.end(),
                     [](char c) { return is_digit(c) || c == '.'; });
}

/// A name that udev may give: no folder, nothing hidden.
bool is_link_name(std::string_view name) {
  constexpr std::string_view kAlso = "#+-.:=@_";
  return !name.empty() && name.front() != '.' && std::all_of(name.begin(), name.end(), [&](char c) {
    return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           kAlso.find(c) != std::string_view::npos;
  });
}

void parse_hid(DeviceUrl& url, std::string_view rest) {
  if (rest.starts_with("/")) {
    constexpr std::string_view kNode = "/dev/hidraw";
    constexpr std::string_view kLink = "/dev/forcegrid/";
    if (rest.starts_with(kLink) && is_link_name(rest.substr(kLink.size()))) {
      url.kind = DeviceUrl::Kind::kHidNode;
      url.node = rest;
      return;
    }
    const std::string_view number =
        rest.starts_with(kNode) ? rest.substr(kNode.size()) : std::string_view();
    if (number.empty() || number.size() > 5 ||
        !std::all_of(number.begin(), number.end(), is_digit)) {
      fail(url.text,
           quoted(rest) + " is not /dev/hidraw and a number, nor a link of /dev/forcegrid");
    }
    url.kind = DeviceUrl::Kind::kHidNode;
    url.node = rest;
    return;
  }
  if (rest.starts_with("path=")) {
    rest.remove_prefix(5);
    if (!is_port_path(rest)) {
      fail(url.text, quoted(rest) + " is not a USB port such as 1-2 or 1-2.4");
    }
    url.kind = DeviceUrl::Kind::kHidPort;
    url.port_path = rest;
    return;
  }
  const std::size_t colon = rest.find(':');
  if (colon == std::string_view::npos) {
    fail(url.text, "the product number is missing");
  }
  url.kind = DeviceUrl::Kind::kHidId;
  url.vendor_id = parse_id(url.text, rest.substr(0, colon), "vendor number");
  rest.remove_prefix(colon + 1);
  const std::size_t second = rest.find(':');
  url.product_id = parse_id(url.text, rest.substr(0, second), "product number");
  if (second != std::string_view::npos) {
    url.serial = rest.substr(second + 1);
    if (url.serial.empty()) {
      fail(url.text, "the serial number after the last colon is empty");
    }
  }
}

/// @param rest  what follows "falcon": nothing, or a colon and more.
void parse_falcon(DeviceUrl& url, std::string_view rest) {
  url.kind = DeviceUrl::Kind::kFalcon;
  if (rest.empty()) {
    return;
  }
  rest.remove_prefix(1);
  if (rest.starts_with("path=")) {
    rest.remove_prefix(5);
    if (!is_port_path(rest)) {
      fail(url.text, quoted(rest) + " is not a USB port such as 1-2 or 1-2.4");
    }
    url.port_path = rest;
    return;
  }
  if (rest.empty()) {
    fail(url.text, "the serial number after the colon is empty");
  }
  url.serial = rest;
}

void parse_usbip(DeviceUrl& url, std::string_view rest) {
  url.kind = DeviceUrl::Kind::kUsbip;
  const std::size_t slash = rest.find('/');
  if (slash == std::string_view::npos) {
    fail(url.text, "the bus id after the port is missing");
  }
  const std::string_view bus_id = rest.substr(slash + 1);
  if (!is_port_path(bus_id)) {
    fail(url.text, quoted(bus_id) + " is not a bus id such as 1-1");
  }
  url.bus_id = bus_id;
  std::string_view authority = rest.substr(0, slash);
  std::string_view port;
  if (authority.starts_with('[')) {
    const std::size_t bracket = authority.find("]:");
    if (bracket == std::string_view::npos) {
      fail(url.text, "the address in brackets must be followed by a colon and the port");
    }
    url.host = authority.substr(1, bracket - 1);
    port = authority.substr(bracket + 2);
  } else {
    const std::size_t colon = authority.find(':');
    if (colon == std::string_view::npos) {
      fail(url.text, "the port is missing (3240 is usual)");
    }
    url.host = authority.substr(0, colon);
    port = authority.substr(colon + 1);
  }
  if (url.host.empty()) {
    fail(url.text, "the host is missing");
  }
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), url.tcp_port);
  if (port.empty() || error != std::errc() || end != port.data() + port.size() ||
      url.tcp_port == 0) {
    fail(url.text, quoted(port) + " is not a port from 1 to 65535");
  }
}

}  // namespace

DeviceUrl parse_device_url(const std::string& text) {
  DeviceUrl url;
  url.text = text;
  constexpr std::string_view kHid = "hid:";
  constexpr std::string_view kUsbip = "usbip://";
  constexpr std::string_view kFalcon = "falcon";
  if (std::any_of(text.begin(), text.end(), [](char c) { return c <= ' ' || c == '\x7f'; })) {
    fail(text, "it contains a blank or a control character");
  }
  if (text.starts_with(kHid)) {
    parse_hid(url, std::string_view(text).substr(kHid.size()));
  } else if (text.starts_with(kUsbip)) {
    parse_usbip(url, std::string_view(text).substr(kUsbip.size()));
  } else if (text == kFalcon || text.starts_with(std::string(kFalcon) + ":")) {
    parse_falcon(url, std::string_view(text).substr(kFalcon.size()));
  } else {
    fail(text, "it begins with neither hid: nor usbip:// nor falcon");
  }
  return url;
}

const char* device_url_forms() noexcept {
  return "  hid:1234:0006[:SERIAL]   vendor and product number, as lsusb shows them\n"
         "  hid:/dev/hidrawN         a device node\n"
         "  hid:/dev/forcegrid/LINK  the same by the lasting name that the udev rule gives it\n"
         "  hid:path=BUS-PORT        the USB port, e.g. 1-2 (W2 devices share one serial number)\n"
         "  falcon[:SERIAL]          an attached Novint Falcon; also falcon:path=BUS-PORT\n"
         "  usbip://HOST:PORT/BUSID  a device on a USB/IP server, e.g. usbip://127.0.0.1:3240/1-1\n"
         "  emulated:PROFILE         an emulated device, e.g. emulated:woodenhaptics_v2015";
}

}  // namespace forcegrid::driver
