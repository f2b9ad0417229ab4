// SPDX-License-Identifier: Apache-2.0
#include "driver/usb_presence.h"

#include <filesystem>
#include <fstream>
#include <thread>
#include <utility>

namespace forcegrid::driver {
namespace {

namespace fs = std::filesystem;

constexpr rt::Duration kLook = std::chrono::milliseconds(1);

std::string driver_of(const fs::path& interface) {
  std::error_code error;
  return fs::read_symlink(interface / "driver", error).filename().string();
}

}  // namespace

UsbPresence::UsbPresence(std::string port_path, std::string interface, std::string sysfs)
    : sysfs_(std::move(sysfs) + "/bus/usb/devices/"),
      port_path_(std::move(port_path)),
      interface_(std::move(interface)),
      number_(number()),
      driver_(driver_of(sysfs_ + interface_)) {}

std::string UsbPresence::number() const {
  std::ifstream stream(sysfs_ + port_path_ + "/devnum");
  std::string number;
  std::getline(stream, number);
  return number;
}

std::string UsbPresence::taken_by() const {
  if (port_path_.empty() || number_.empty()) {
    return "";
  }
  for (const rt::TimePoint until = rt::Clock::now() + kDisappears;;
       std::this_thread::sleep_for(kLook)) {
    if (number() != number_) {
      return "";
    }
    const std::string driver = driver_of(sysfs_ + interface_);
    if (!driver.empty() && driver != driver_) {
      return driver;
    }
    if (rt::Clock::now() >= until) {
      return driver.empty() ? "none" : "";
    }
  }
}

}  // namespace forcegrid::driver
