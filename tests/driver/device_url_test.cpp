// SPDX-License-Identifier: Apache-2.0
#include "driver/device_url.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

using testing::HasSubstr;

TEST(DeviceUrl, ReadsVendorAndProduct) {
  const DeviceUrl url = parse_device_url("hid:1234:00aF");
  EXPECT_EQ(url.kind, DeviceUrl::Kind::kHidId);
  EXPECT_EQ(url.vendor_id, 0x1234);
  EXPECT_EQ(url.product_id, 0x00AF);
  EXPECT_EQ(url.serial, "");
  EXPECT_EQ(parse_device_url("hid:1234:0006:01:23").serial, "01:23");
}

TEST(DeviceUrl, ReadsNodeAndPort) {
  EXPECT_EQ(parse_device_url("hid:/dev/hidraw12").node, "/dev/hidraw12");
  EXPECT_EQ(parse_device_url("hid:/dev/forcegrid/w2-pci-0000:00:14.0-usb-0:2:1.0").node,
            "/dev/forcegrid/w2-pci-0000:00:14.0-usb-0:2:1.0");
  const DeviceUrl port = parse_device_url("hid:path=3-1.4");
  EXPECT_EQ(port.kind, DeviceUrl::Kind::kHidPort);
  EXPECT_EQ(port.port_path, "3-1.4");
}

TEST(DeviceUrl, ReadsUsbipServers) {
  const DeviceUrl url = parse_device_url("usbip://127.0.0.1:3240/1-1");
  EXPECT_EQ(url.kind, DeviceUrl::Kind::kUsbip);
  EXPECT_EQ(url.host, "127.0.0.1");
  EXPECT_EQ(url.tcp_port, 3240);
  EXPECT_EQ(url.bus_id, "1-1");
  EXPECT_EQ(parse_device_url("usbip://[::1]:65535/2-1.3").host, "::1");
}

TEST(DeviceUrl, ReadsFalcons) {
  const DeviceUrl any = parse_device_url("falcon");
  EXPECT_EQ(any.kind, DeviceUrl::Kind::kFalcon);
  EXPECT_EQ(any.serial, "");
  EXPECT_EQ(any.port_path, "");
  EXPECT_EQ(parse_device_url("falcon:FV:0815").serial, "FV:0815");
  const DeviceUrl port = parse_device_url("falcon:path=1-2.3");
  EXPECT_EQ(port.port_path, "1-2.3");
  EXPECT_EQ(port.serial, "");
}

TEST(DeviceUrl, RefusesEverythingElseWithTheReasonAndTheForms) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "neither hid: nor usbip:// nor falcon"},
      {"1234:0006", "neither hid: nor usbip:// nor falcon"},
      {"HID:1234:0006", "neither hid: nor usbip:// nor falcon"},
      {"falcons", "neither hid: nor usbip:// nor falcon"},
      {"falcon:", "serial number after the colon is empty"},
      {"falcon:path=2", "'2' is not a USB port"},
      {"hid:", "product number is missing"},
      {"hid:1234", "product number is missing"},
      {"hid:123:0006", "vendor number '123' is not four hexadecimal digits"},
      {"hid:12345:0006", "vendor number '12345'"},
      {"hid:0x12:0006", "vendor number '0x12'"},
      {"hid:1234:000g", "product number '000g'"},
      {"hid:1234:-006", "product number '-006'"},
      {"hid:1234:0006:", "serial number after the last colon is empty"},
      {"hid:1234:0006 ", "blank or a control character"},
      {"hid:/dev/hidraw", "'/dev/hidraw' is not /dev/hidraw and a number"},
      {"hid:/dev/ttyACM0", "is not /dev/hidraw and a number"},
      {"hid:/dev/hidraw1/../sda", "is not /dev/hidraw and a number"},
      {"hid:/dev/forcegrid/", "nor a link of /dev/forcegrid"},
      {"hid:/dev/forcegrid/../sda", "nor a link of /dev/forcegrid"},
      {"hid:path=", "is not a USB port"},
      {"hid:path=1", "'1' is not a USB port"},
      {"hid:path=1-", "is not a USB port"},
      {"hid:path=1-2..3", "is not a USB port"},
      {"hid:path=../..", "is not a USB port"},
      {"usbip://host:3240", "bus id after the port is missing"},
      {"usbip://host/1-1", "port is missing"},
      {"usbip://:3240/1-1", "host is missing"},
      {"usbip://host:0/1-1", "'0' is not a port"},
      {"usbip://host:65536/1-1", "'65536' is not a port"},
      {"usbip://host:32x/1-1", "'32x' is not a port"},
      {"usbip://host:3240/", "'' is not a bus id"},
      {"usbip://host:3240/1-1111111111111111111111111111111111", "is not a bus id"},
      {"usbip://[::1]/1-1", "must be followed by a colon and the port"},
  };
  for (const auto& [text, words] : cases) {
    try {
      static_cast<void>(parse_device_url(text));
      ADD_FAILURE() << "accepted '" << text << "'";
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr(words));
      EXPECT_THAT(error.what(), HasSubstr("device '" + std::string(text) + "'"));
      EXPECT_THAT(error.what(), HasSubstr("usbip://HOST:PORT/BUSID"));
    }
  }
}

}  // namespace
}  // namespace forcegrid::driver
