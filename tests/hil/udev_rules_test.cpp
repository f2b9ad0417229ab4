// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid {
namespace {

std::vector<std::string> rules() {
  std::ifstream file(FORCEGRID_SOURCE_DIR "/udev/10-forcegrid.rules");
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty() && line.front() != '#') {
      lines.push_back(line);
    }
  }
  return lines;
}

std::string hex4(std::uint16_t value) {
  char text[8];
  std::snprintf(text, sizeof text, "%04x", value);
  return text;
}

bool any_has(const std::vector<std::string>& parts) {
  for (const std::string& line : rules()) {
    bool has_all = true;
    for (const std::string& part : parts) {
      has_all = has_all && line.find(part) != std::string::npos;
    }
    if (has_all) {
      return true;
    }
  }
  return false;
}

TEST(UdevRules, CoverUsbAndHidrawNodesOfEveryProfile) {
  ASSERT_FALSE(profiles::available_profiles().empty());
  for (const std::string& name : profiles::available_profiles()) {
    const auto usb = profiles::load_device_profile(name).usb;
    const std::string ids = "{idVendor}==\"" + hex4(usb.vendor_id) + "\", ";
    const std::string product = "{idProduct}==\"" + hex4(usb.product_id) + "\"";
    EXPECT_TRUE(any_has({"SUBSYSTEM==\"usb\"", "ATTR" + ids, "ATTR" + product})) << name;
    // Only the HID devices, the arms, have a hidraw node.
    const bool hid = usb.protocol != "falcon";
    EXPECT_EQ(any_has({"SUBSYSTEM==\"hidraw\"", "ATTRS" + ids, "ATTRS" + product}), hid) << name;
  }
}

TEST(UdevRules, AreNeverWorldWritable) {
  int modes = 0;
  for (const std::string& line : rules()) {
    const std::size_t mode = line.find("MODE");
    if (mode != std::string::npos) {
      ++modes;
      // Final: another vendor's MODE="0666" has no effect, before or after it.
      EXPECT_EQ(line.substr(mode, 12), "MODE:=\"0660\"") << line;
      EXPECT_NE(line.find("GROUP:=\"plugdev\""), std::string::npos) << line;
      EXPECT_NE(line.find("TAG+=\"uaccess\""), std::string::npos) << line;
    }
  }
  EXPECT_GE(modes, 2);
}

}  // namespace
}  // namespace forcegrid
