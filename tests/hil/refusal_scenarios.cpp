// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <linux/input.h>
#include <linux/uhid.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

std::string first_line(const fs::path& path) {
  std::ifstream stream(path);
  std::string line;
  std::getline(stream, line);
  return line;
}

std::string run_command(const std::string& device) {
  return "forcegrid run --device " + device + " --calibrated --device-timeout-ms 400 --scene " +
         tiny_scene() + " --no-reference --seconds 0.5 --out /tmp/out-$(id -u)";
}

/// The owner may read and write, the group plugdev too, others nothing.
void expect_for_plugdev_only(const std::string& path) {
  struct stat status {};
  ASSERT_EQ(::stat(path.c_str(), &status), 0) << path << ": " << std::strerror(errno);
  EXPECT_EQ(status.st_mode & 07777, 0660U) << path;
  EXPECT_EQ(status.st_uid, 0U) << path;
  const group* const plugdev = ::getgrnam("plugdev");
  ASSERT_NE(plugdev, nullptr);
  EXPECT_EQ(status.st_gid, plugdev->gr_gid) << path;
}

void expect_uaccess(const std::string& sysfs) {
  EXPECT_THAT(shell("udevadm info --query=property --path=" + sysfs).text,
              HasSubstr("CURRENT_TAGS=:"));
  EXPECT_THAT(shell("udevadm info --query=property --path=" + sysfs).text, HasSubstr(":uaccess:"));
}

// --- udev/10-forcegrid.rules ---

TEST(UdevRule, GivesUsbAndHidrawNodesToTheSeatAndToPlugdev) {
  const Bench bench({"woodenhaptics_v2015", "phantom_desktop"});
  ASSERT_EQ(bench.nodes().size(), 2U);
  for (const Node& node : bench.nodes()) {
    const fs::path usb = "/sys/bus/usb/devices/" + node.port;
    SCOPED_TRACE(first_line(usb / "product"));
    expect_for_plugdev_only(node.dev());
    expect_uaccess("/sys/class/hidraw/" + node.name);
    char usb_node[64];
    std::snprintf(usb_node, sizeof usb_node, "/dev/bus/usb/%03d/%03d",
                  std::stoi(first_line(usb / "busnum")), std::stoi(first_line(usb / "devnum")));
    expect_for_plugdev_only(usb_node);
    expect_uaccess(usb.string());
    EXPECT_EQ(first_line(usb / "power/control"), "on") << "it may be suspended";
  }
}

TEST(LongUdevRule, LinksBySerialAndWhereThatIsTheSameOnAllByPort) {
  Bench bench({"woodenhaptics_v2015", "woodenhaptics_v2015", "phantom_desktop"});
  ASSERT_EQ(bench.nodes().size(), 3U);
  // udev may not even have heard of a device whose node is there, and settles at once.
  const auto expect_target = [](const std::string& name, const std::string& expected) {
    const auto target = [&] {
      std::error_code error;
      return fs::canonical("/dev/forcegrid/" + name, error).string();
    };
    EXPECT_TRUE(eventually([&] { return target() == expected; })) << name << " -> " << target();
  };
  const auto link_by_port = [](const Node& node) {
    // udev's name of a path: the controller, then the port without the number of the bus.
    return "w2-platform-vhci_hcd.0-usb-0:" + node.port.substr(node.port.find('-') + 1) + ":1.0";
  };
  for (const std::size_t i : {0U, 1U}) {
    const Node& node = bench.nodes()[i];
    expect_target(link_by_port(node), node.dev());
  }
  expect_target("phantom-PHANTOM-0001", bench.nodes()[2].dev());

  // The cable out and in again: the link is gone with the device, and comes back with it.
  bench.unplug(0);
  const std::string link = link_by_port(bench.nodes()[0]);
  expect_target(link, "");
  bench.plug_in("1-1");
  ASSERT_TRUE(eventually([] { return nodes().size() == 3; }));
  expect_target(link, nodes().front().dev());
}

TEST(UdevRule, LetsAMemberOfPlugdevRunAndNobodyElse) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const ShellResult member = as_user("operator", run_command("hid:1234:0006"));
  EXPECT_EQ(member.status, 0) << member.text;
  EXPECT_THAT(member.text, HasSubstr("zero current at the end delivered"));
  const ShellResult other = as_user("visitor", run_command("hid:1234:0006"));
  EXPECT_EQ(other.status, 1) << other.text;
  EXPECT_THAT(other.text, HasSubstr("open " + bench.node().dev() + ": Permission denied"));
  EXPECT_THAT(other.text, HasSubstr("udev/10-forcegrid.rules"));
  EXPECT_EQ(as_user("visitor", "cat /dev/bus/usb/*/* > /dev/null").status, 1);
}

TEST(WithoutTheRule, OnlyRootMayOpenAndTheMessageNamesTheRule) {
  const RuleTakenAway before_installation;
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  struct stat status {};
  ASSERT_EQ(::stat(bench.node().dev().c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600U);
  EXPECT_FALSE(fs::exists("/dev/forcegrid"));
  const ShellResult refused = as_user("operator", run_command("hid:1234:0006"));
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, AllOf(HasSubstr("open " + bench.node().dev() +
                                            ": Permission denied; install udev/10-forcegrid.rules"),
                                  HasSubstr("[known, but can't be opened: Permission denied]")));
}

// --- what must not be opened ---

TEST(LongRefusal, AnUnknownSerialNumberListsWhatThereIs) {
  Bench bench;
  const EndedRun refused = run("hid:1234:0006:9876543210", 1.0);
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text,
              AllOf(HasSubstr("device 'hid:1234:0006:9876543210': not found"),
                    HasSubstr(bench.node().dev() + " at USB port " + bench.node().port),
                    HasSubstr("serial 0123456789")));
  EXPECT_EQ(bench.end().at("reports_received"), 0);
}

TEST(LongRefusal, ADeviceThatAnotherProgramDrives) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const std::string folder = forcegrid::testing::fresh_folder("first");
  Program first = Program::forcegrid(run_arguments("hid:1234:0006", 4.0, folder, {"--calibrated"}));
  first.wait_for_line("Simulator: ");
  const EndedRun second = run("hid:1234:0006", 1.0, {"--calibrated"});
  EXPECT_EQ(second.status, 1);
  EXPECT_THAT(second.text, HasSubstr("another program drives this device"));
  EXPECT_EQ(first.wait(std::chrono::seconds(40)).value_or(-1), 0)
      << first.standard_output() << first.standard_error();
}

/// A HID device that the kernel makes from a descriptor, without USB.
class UhidDevice {
 public:
  explicit UhidDevice(const std::vector<unsigned char>& report_descriptor)
      : descriptor_(::open("/dev/uhid", O_RDWR | O_CLOEXEC)) {
    EXPECT_GE(descriptor_, 0) << "/dev/uhid: " << std::strerror(errno);
    uhid_event event{};
    event.type = UHID_CREATE2;
    std::strcpy(reinterpret_cast<char*>(event.u.create2.name), "mbed.org HID DEVICE");
    event.u.create2.bus = BUS_USB;
    event.u.create2.vendor = 0x1234;
    event.u.create2.product = 0x0006;
    event.u.create2.rd_size = static_cast<std::uint16_t>(report_descriptor.size());
    std::copy(report_descriptor.begin(), report_descriptor.end(), event.u.create2.rd_data);
    EXPECT_EQ(::write(descriptor_, &event, sizeof event), static_cast<ssize_t>(sizeof event));
    for (int i = 0; i < 200 && nodes().empty(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    shell("udevadm settle --timeout=20");
  }
  ~UhidDevice() {
    ::close(descriptor_);
    for (int i = 0; i < 200 && !nodes().empty(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  UhidDevice(const UhidDevice&) = delete;
  UhidDevice& operator=(const UhidDevice&) = delete;

  /// Output reports that the host has sent so far.
  int outputs() const {
    int found = 0;
    pollfd entry{.fd = descriptor_, .events = POLLIN, .revents = 0};
    uhid_event event{};
    while (::poll(&entry, 1, 0) == 1 && ::read(descriptor_, &event, sizeof event) > 0) {
      found += event.type == UHID_OUTPUT ? 1 : 0;
    }
    return found;
  }

 private:
  int descriptor_;
};

TEST(Refusal, TheOlderW1FirmwareIsNamedAndGetsNoCommand) {
  const UhidDevice w1({0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75,
                       0x08, 0x15, 0x00, 0x25, 0xFF, 0x95, 0x08, 0x09, 0x01,
                       0x81, 0x02, 0x95, 0x08, 0x09, 0x02, 0x91, 0x02, 0xC0});
  ASSERT_EQ(nodes().size(), 1U);
  const EndedRun refused = run("hid:1234:0006", 1.0);
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, HasSubstr("the older W1 protocol (reports of 8 bytes)"));
  EXPECT_THAT(refused.text, HasSubstr("install the W2 firmware"));
  const Answer devices = ask("root", "devices");
  EXPECT_EQ(obstacle(devices).at("kind"), "descriptor");
  EXPECT_THAT(obstacle(devices).at("what").get<std::string>(), HasSubstr("W1"));
  EXPECT_EQ(w1.outputs(), 0);
}

TEST(Refusal, AMouseWithTheDevicesNumbersGetsNoCommand) {
  // USB HID 1.11, appendix E.10: a boot mouse.
  const UhidDevice mouse({0x05, 0x01, 0x09, 0x02, 0xA1, 0x01, 0x09, 0x01, 0xA1, 0x00,
                          0x05, 0x09, 0x19, 0x01, 0x29, 0x03, 0x15, 0x00, 0x25, 0x01,
                          0x95, 0x03, 0x75, 0x01, 0x81, 0x02, 0x95, 0x01, 0x75, 0x05,
                          0x81, 0x01, 0x05, 0x01, 0x09, 0x30, 0x09, 0x31, 0x15, 0x81,
                          0x25, 0x7F, 0x75, 0x08, 0x95, 0x02, 0x81, 0x06, 0xC0, 0xC0});
  ASSERT_EQ(nodes().size(), 1U);
  const EndedRun refused = run("hid:1234:0006", 1.0);
  EXPECT_EQ(refused.status, 1);
  EXPECT_THAT(refused.text, HasSubstr("its HID usage is 0001:0002 where profile "
                                      "'woodenhaptics_v2015' has ffab:0200"));
  EXPECT_EQ(obstacle(ask("root", "devices")).at("kind"), "descriptor");
  EXPECT_EQ(mouse.outputs(), 0);
}

}  // namespace
}  // namespace forcegrid::hil
