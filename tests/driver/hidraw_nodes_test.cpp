// SPDX-License-Identifier: Apache-2.0
#include "driver/hidraw_nodes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "driver/device.h"
#include "driver/discovery.h"
#include "driver/hidraw_transport.h"
#include "driver/open_device.h"

namespace forcegrid::driver {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// A sysfs tree as the kernel lays it out, in a temporary folder.
class Sysfs : public testing::Test {
 public:
  ~Sysfs() override {
    std::error_code error;
    fs::remove_all(root_, error);
  }

 protected:
  Sysfs() {
    std::string pattern = (fs::temp_directory_path() / "forcegrid_sysfs_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) {
      throw std::runtime_error("mkdtemp failed");
    }
    root_ = pattern;
    fs::create_directories(root_ / "class/hidraw");
  }

  static void write(const fs::path& path, const std::string& text) {
    std::ofstream(path, std::ios::binary) << text;
  }

  void add_usb(int number, const std::string& port, const std::string& serial) {
    const fs::path usb = root_ / "devices/pci0000:00/usb1" / port;
    const fs::path hid = usb / (port + ":1.0") / ("0003:1234:0006.000" + std::to_string(number));
    fs::create_directories(hid);
    write(usb / "idVendor", "1234\n");
    write(usb / "manufacturer", "mbed.org\n");
    write(usb / "product", "HID DEVICE\n");
    write(usb / "serial", serial + "\n");
    write(hid / "uevent", "DRIVER=hid-generic\nHID_ID=0003:00001234:00000006\nHID_NAME=x\n");
    write(hid / "report_descriptor", std::string("\x06\xAB\xFF", 3));
    link(number, hid);
  }

  void add_bluetooth(int number) {
    const fs::path hid = root_ / "devices/virtual/misc/uhid/0005:046D:B013.0009";
    fs::create_directories(hid);
    write(hid / "uevent", "HID_ID=0005:0000046D:0000B013\nHID_NAME=Mouse\nHID_UNIQ=aa:bb\n");
    link(number, hid);
  }

  void link(int number, const fs::path& hid) {
    const fs::path node = root_ / "class/hidraw" / ("hidraw" + std::to_string(number));
    fs::create_directories(node);
    fs::create_directory_symlink(hid, node / "device");
  }

  std::string error_of(const std::string& url) {
    try {
      static_cast<void>(
          select_hidraw_node(parse_device_url(url), list_hidraw_nodes(root_.string())));
    } catch (const DeviceError& error) {
      return error.what();
    }
    return "found";
  }

  fs::path root_;
};

TEST_F(Sysfs, DescribesUsbNodesInTheOrderOfTheirNumbers) {
  add_usb(10, "1-2", "0123456789");
  add_usb(2, "1-1.4", "77");
  add_bluetooth(3);
  const auto nodes = list_hidraw_nodes(root_.string());
  ASSERT_EQ(nodes.size(), 3U);
  EXPECT_EQ(nodes[0].node, "/dev/hidraw2");
  EXPECT_EQ(nodes[0].port_path, "1-1.4");
  EXPECT_EQ(nodes[0].serial, "77");
  EXPECT_EQ(nodes[1].port_path, "");
  EXPECT_EQ(nodes[1].vendor_id, 0x046D);
  EXPECT_EQ(nodes[1].serial, "aa:bb");
  EXPECT_EQ(nodes[2].node, "/dev/hidraw10");
  EXPECT_EQ(nodes[2].vendor_id, 0x1234);
  EXPECT_EQ(nodes[2].product_id, 0x0006);
  EXPECT_EQ(nodes[2].manufacturer, "mbed.org");
  EXPECT_EQ(nodes[2].report_descriptor, (std::vector<std::uint8_t>{0x06, 0xAB, 0xFF}));
}

TEST_F(Sysfs, FindsADeviceByNumbersSerialNodeAndPort) {
  add_usb(0, "1-2", "0123456789");
  add_usb(1, "1-3", "other");
  const auto nodes = list_hidraw_nodes(root_.string());
  const auto found = [&](const char* url) {
    return select_hidraw_node(parse_device_url(url), nodes).port_path;
  };
  EXPECT_EQ(found("hid:1234:0006:other"), "1-3");
  EXPECT_EQ(found("hid:/dev/hidraw0"), "1-2");
  EXPECT_EQ(found("hid:path=1-3"), "1-3");
}

TEST_F(Sysfs, RefusesToGuessBetweenDevicesOfOneSerialAndListsTheirPorts) {
  add_usb(0, "1-2", "0123456789");
  add_usb(1, "1-3", "0123456789");
  for (const char* url : {"hid:1234:0006", "hid:1234:0006:0123456789"}) {
    const std::string error = error_of(url);
    EXPECT_THAT(error, HasSubstr("2 devices match"));
    EXPECT_THAT(error, HasSubstr("USB port 1-2"));
    EXPECT_THAT(error, HasSubstr("USB port 1-3"));
    EXPECT_THAT(error, HasSubstr("hid:path=1-2"));
  }
}

TEST_F(Sysfs, SaysWhatIsThereWhenTheDeviceIsNot) {
  EXPECT_THAT(error_of("hid:1234:0006"), HasSubstr("no HID device at all"));
  add_bluetooth(3);
  EXPECT_THAT(error_of("hid:1234:0006"), HasSubstr("/dev/hidraw3: 046d:b013"));
  EXPECT_THAT(error_of("hid:path=1-9"), HasSubstr("not found"));
}

TEST_F(Sysfs, DescribesWhatWasLookedForFoundAndWhatToDo) {
  const std::vector<profiles::DeviceProfile> known = {
      profiles::load_device_profile("woodenhaptics_v2015")};
  const std::string none = describe_attached_devices(known, root_.string());
  EXPECT_THAT(none, HasSubstr("1234:0006  woodenhaptics_v2015"));
  EXPECT_THAT(none, HasSubstr("no HID device at all"));
  EXPECT_THAT(none, HasSubstr("udev/10-forcegrid.rules"));
  EXPECT_THAT(none, HasSubstr("--device emulated:woodenhaptics_v2015"));
  add_usb(4242, "1-2", "0123456789");
  const std::string one = describe_attached_devices(known, root_.string());
  EXPECT_THAT(one, HasSubstr("/dev/hidraw4242 at USB port 1-2: 1234:0006"));
  EXPECT_THAT(one, HasSubstr("[known, but can't be opened: No such file"));
  EXPECT_THAT(one, HasSubstr("--device hid:path=1-2"));
}

TEST_F(Sysfs, DescribesAFalconWhichHasNoHidNode) {
  const auto device = root_ / "bus" / "usb" / "devices" / "2-1.3";
  std::filesystem::create_directories(device);
  std::ofstream(device / "idVendor") << "0403\n";
  std::ofstream(device / "idProduct") << "cb48\n";
  std::ofstream(device / "serial") << "FV0815\n";
  const std::string text =
      describe_attached_devices({profiles::load_device_profile("woodenhaptics_v2015"),
                                 profiles::load_device_profile("falcon")},
                                root_.string());
  EXPECT_THAT(text, HasSubstr("0403:cb48 at USB port 2-1.3, serial FV0815 [known]"));
  EXPECT_THAT(text, HasSubstr("--device falcon:path=2-1.3"));
  // Not one of the profiles' devices: any other FTDI chip.
  std::ofstream(device / "idProduct") << "6001\n";
  EXPECT_THAT(describe_attached_devices({profiles::load_device_profile("falcon")}, root_.string()),
              HasSubstr("no HID device at all, and no Falcon"));
}

TEST(HidrawNodes, OfACompositeDeviceOnlyTheInterfaceWithTheUsageIsLeft) {
  // The two interfaces of a Teensy RawHID (sheet section 2.2), and a mouse at another port.
  const auto node = [](const std::string& name, const std::string& port,
                       std::vector<std::uint8_t> descriptor) {
    HidrawNode result;
    result.node = name;
    result.port_path = port;
    result.report_descriptor = std::move(descriptor);
    return result;
  };
  const std::vector<std::uint8_t> raw_hid = {
      0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75, 0x08, 0x15, 0x00, 0x26, 0xFF,
      0x00, 0x95, 0x40, 0x09, 0x01, 0x81, 0x02, 0x95, 0x40, 0x09, 0x02, 0x91, 0x02, 0xC0};
  const std::vector<std::uint8_t> serial_line = {0x06, 0xC9, 0xFF, 0x09, 0x04, 0xA1, 0x5C, 0x75,
                                                 0x08, 0x95, 0x40, 0x09, 0x75, 0x81, 0x02, 0xC0};
  const std::vector<HidrawNode> nodes = {
      node("/dev/hidraw0", "1-2", serial_line), node("/dev/hidraw1", "1-2", raw_hid),
      node("/dev/hidraw2", "1-3", serial_line), node("/dev/hidraw3", "", serial_line)};
  const auto left = without_other_interfaces(nodes, 0xFFAB, 0x0200);
  ASSERT_EQ(left.size(), 3U) << "a device without the usage stays: opening it says what is wrong";
  EXPECT_EQ(left[0].node, "/dev/hidraw1");
  EXPECT_EQ(left[1].node, "/dev/hidraw2");
  EXPECT_EQ(left[2].node, "/dev/hidraw3");
  EXPECT_EQ(without_other_interfaces(nodes, 0x0001, 0x0002).size(), 4U);
}

TEST(HidrawTransport, NamesANodeThatCannotBeOpened) {
  HidrawNode node;
  node.node = "/dev/hidraw99999";
  try {
    static_cast<void>(open_hidraw_transport(node));
    ADD_FAILURE() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("open /dev/hidraw99999: "));
    EXPECT_THAT(error.what(), HasSubstr("plug the device in again"));
  }
}

TEST(OpenDevice, SaysThatNoSuchDeviceIsAttached) {
  try {
    static_cast<void>(open_device("hid:1234:0006:no-such-serial",
                                  profiles::load_device_profile("woodenhaptics_v2015")));
    ADD_FAILURE() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("device 'hid:1234:0006:no-such-serial': not found"));
    EXPECT_THAT(error.what(), HasSubstr("emulated:"));
  }
}

}  // namespace
}  // namespace forcegrid::driver
