// SPDX-License-Identifier: Apache-2.0
#include "tools/device_survey.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "profiles/device_profile.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Sheet 3.3: reports of `bytes` each way; 14 is W2, 8 the older W1.
std::string descriptor(int bytes, int usage_page_low = 0xAB) {
  std::string text;
  for (const int byte : {0x06, usage_page_low, 0xFF, 0x0A,  0x00, 0x02, 0xA1,  0x01, 0x75,
                         0x08, 0x15,           0x00, 0x25,  0xFF, 0x95, bytes, 0x09, 0x01,
                         0x81, 0x02,           0x95, bytes, 0x09, 0x02, 0x91,  0x02, 0xC0}) {
    text += static_cast<char>(byte);
  }
  return text;
}

// A computer in a folder: /sys, /dev, /proc and the folders of udev's rules.
class Computer : public ::testing::Test {
 public:
  ~Computer() override { fs::remove_all(root_); }

 protected:
  Computer() : root_(::testing::TempDir() + "computer_" + std::to_string(getpid())) {
    fs::remove_all(root_);
    for (const char* folder : {"sys/class/hidraw", "sys/bus/usb/devices", "dev/bus/usb/001", "proc",
                               "etc/udev/rules.d", "lib/udev/rules.d"}) {
      fs::create_directories(root_ / folder);
    }
    roots_.sysfs = root_ / "sys";
    roots_.dev = root_ / "dev";
    roots_.proc = root_ / "proc";
    roots_.rule_folders = {root_ / "etc/udev/rules.d", root_ / "lib/udev/rules.d"};
    user_.name = "ada";
    user_.may_open = [this](const std::string&) { return may_open_; };
    for (const std::string& name : profiles::available_profiles()) {
      known_.push_back(profiles::load_device_profile(name));
    }
  }

  static void write(const fs::path& file, const std::string& text) {
    fs::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << text;
  }

  fs::path add_usb(const std::string& port, const std::string& vendor, const std::string& product) {
    const fs::path usb = root_ / "sys/devices/usb1" / port;
    write(usb / "idVendor", vendor + "\n");
    write(usb / "idProduct", product + "\n");
    write(usb / "manufacturer", "mbed.org\n");
    write(usb / "product", "HID DEVICE\n");
    write(usb / "serial", "0123456789\n");
    write(usb / "busnum", "1\n");
    write(usb / "devnum", "4\n");
    write(usb / "power/control", "on\n");
    fs::create_directories(usb / (port + ":1.0"));
    fs::create_directory_symlink(usb, root_ / "sys/bus/usb/devices" / port);
    return usb;
  }

  // A W2 device on hidraw0 at port 1-2. @returns its folder in sysfs.
  fs::path add_w2(const std::string& report_descriptor = descriptor(14)) {
    const fs::path usb = add_usb("1-2", "1234", "0006");
    const fs::path hid = usb / "1-2:1.0" / "0003:1234:0006.0001";
    write(hid / "uevent", "HID_ID=0003:00001234:00000006\nHID_NAME=x\n");
    write(hid / "report_descriptor", report_descriptor);
    fs::create_directories(root_ / "sys/class/hidraw/hidraw0");
    fs::create_directory_symlink(hid, root_ / "sys/class/hidraw/hidraw0/device");
    write(root_ / "dev/hidraw0", "");
    chmod((root_ / "dev/hidraw0").c_str(), 0600);
    return usb;
  }

  std::vector<FoundDevice> survey() const { return survey_devices(known_, roots_, user_); }

  // The one obstacle of the one device.
  Obstacle only_obstacle() const {
    const auto found = survey();
    if (found.size() != 1 || found[0].obstacles.size() != 1) {
      ADD_FAILURE() << found.size() << " devices";
      return {};
    }
    return found[0].obstacles[0];
  }

  void install_rule() const { write(root_ / "etc/udev/rules.d/10-forcegrid.rules", "#\n"); }

  fs::path root_;
  SurveyRoots roots_;
  SurveyUser user_;
  bool may_open_ = true;
  std::vector<profiles::DeviceProfile> known_;
};

TEST_F(Computer, ShowsADeviceThatCanBeUsedAndOnlyOurs) {
  add_w2();
  add_usb("1-1", "046d", "c077");  // a mouse
  const auto found = survey();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_TRUE(found[0].usable());
  EXPECT_TRUE(found[0].obstacles.empty());
  EXPECT_EQ(found[0].bus, "hidraw");
  EXPECT_EQ(found[0].node, "/dev/hidraw0");
  EXPECT_EQ(found[0].url, "hid:path=1-2");
  EXPECT_EQ(found[0].serial, "0123456789");
  EXPECT_THAT(found[0].firmware, HasSubstr("W2 (reports of 14 bytes)"));
  EXPECT_THAT(found[0].profiles, ::testing::Contains("woodenhaptics_v2015"));
}

TEST_F(Computer, NamesTheOneStepThatIsMissingForPermission) {
  add_w2();
  may_open_ = false;
  const gid_t group_of_node = [&] {
    struct stat status {};
    stat((root_ / "dev/hidraw0").c_str(), &status);
    return status.st_gid;
  }();

  // No rule.
  EXPECT_EQ(only_obstacle().kind, "permission");
  EXPECT_TRUE(only_obstacle().blocks);
  EXPECT_THAT(only_obstacle().what, HasSubstr("0600"));
  EXPECT_THAT(only_obstacle().what, HasSubstr("10-forcegrid.rules is not installed"));
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("sudo cp udev/10-forcegrid.rules"));

  // The rule, but no group for it to give the node to.
  install_rule();
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("groupadd --system plugdev"));

  // The rule came after the device.
  user_.plugdev = group_of_node;
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("plug the device in again"));

  // The node is the group's, the user is not in it.
  chmod((root_ / "dev/hidraw0").c_str(), 0660);
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("usermod -aG plugdev ada"));

  // In it, but logged in before.
  user_.plugdev_listed = true;
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("log in again"));
  EXPECT_THAT(only_obstacle().remedy, ::testing::Not(HasSubstr("usermod")));

  user_.plugdev_active = true;
  EXPECT_THAT(only_obstacle().what, HasSubstr("something else denies access"));

  // A rule that a package installed counts as well.
  fs::rename(root_ / "etc/udev/rules.d/10-forcegrid.rules",
             root_ / "lib/udev/rules.d/10-forcegrid.rules");
  EXPECT_THAT(only_obstacle().what, ::testing::Not(HasSubstr("not installed")));
}

TEST_F(Computer, NamesTheProcessThatDrivesTheDevice) {
  add_w2();
  struct stat status {};
  ASSERT_EQ(stat((root_ / "dev/hidraw0").c_str(), &status), 0);
  char lock[120];
  std::snprintf(lock, sizeof lock, "1: FLOCK  ADVISORY  WRITE 4711 %02x:%02x:%llu 0 EOF\n",
                major(status.st_dev), minor(status.st_dev),
                static_cast<unsigned long long>(status.st_ino));
  write(root_ / "proc/locks", lock);
  write(root_ / "proc/4711/comm", "forcegrid\n");
  write(root_ / "proc/4712/comm", "bash\n");
  const Obstacle busy = only_obstacle();
  EXPECT_EQ(busy.kind, "busy");
  EXPECT_TRUE(busy.blocks);
  EXPECT_THAT(busy.what, HasSubstr("4711 (forcegrid)"));
  EXPECT_THAT(busy.remedy, HasSubstr("kill 4711"));

  // Somebody else's program locks nothing, but could command the motors.
  write(root_ / "proc/locks", "");
  fs::create_directories(root_ / "proc/4712/fd");
  fs::create_symlink("/dev/hidraw0", root_ / "proc/4712/fd/7");
  EXPECT_THAT(only_obstacle().what, HasSubstr("4712 (bash)"));
  EXPECT_TRUE(only_obstacle().blocks);
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("run with --share"));
}

TEST_F(Computer, NamesTheFileThatOpensTheNodeToEveryAccount) {
  add_w2();
  chmod((root_ / "dev/hidraw0").c_str(), 0666);
  EXPECT_EQ(only_obstacle().kind, "open to all");
  EXPECT_FALSE(only_obstacle().blocks);
  EXPECT_THAT(only_obstacle().what, HasSubstr("0666: every account of this computer may command"));
  EXPECT_THAT(only_obstacle().what, HasSubstr("no udev rule does that"));
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("sudo chmod o-rw /dev/hidraw0"));

  const std::string file = root_ / "etc/udev/rules.d/99-vendor.rules";
  write(file, "# Robots\n\nKERNEL==\"hidraw*\", ATTRS{idVendor}==\"1234\", MODE=\"0666\"\n");
  EXPECT_THAT(only_obstacle().what, HasSubstr(file + ":3 does that (MODE=\"0666\")"));
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("sudo cp udev/10-forcegrid.rules"));
  install_rule();
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("sudo make install-udev"));

  // Final and before ours.
  write(root_ / "lib/udev/rules.d/05-vendor.rules", "SUBSYSTEM==\"hidraw\", MODE:=\"0666\"\n");
  EXPECT_THAT(only_obstacle().what, HasSubstr("05-vendor.rules:1 does that (MODE:=\"0666\")"));
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("no later rule can undo it"));
}

TEST_F(Computer, ReadsTheLocksOfARealKernel) {
  add_w2();
  roots_.proc = "/proc";
  const int node = open((root_ / "dev/hidraw0").c_str(), O_RDWR);
  ASSERT_GE(node, 0);
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t other = fork();
  if (other == 0) {
    const int own = open((root_ / "dev/hidraw0").c_str(), O_RDWR);
    const bool locked = flock(own, LOCK_EX | LOCK_NB) == 0;
    const char byte = locked ? 1 : 0;
    _exit(::write(ready[1], &byte, 1) == 1 ? pause() : 1);
  }
  char locked = 0;
  ASSERT_EQ(read(ready[0], &locked, 1), 1);
  ASSERT_EQ(locked, 1);
  EXPECT_THAT(only_obstacle().what, HasSubstr("process " + std::to_string(other)));
  kill(other, SIGKILL);
  waitpid(other, nullptr, 0);
  close(node);
}

TEST_F(Computer, RefusesDescriptorsThatAreNotOurs) {
  const fs::path usb = add_w2(descriptor(8));
  EXPECT_EQ(only_obstacle().kind, "descriptor");
  EXPECT_THAT(only_obstacle().what, HasSubstr("W1"));
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("install the W2 firmware"));
  EXPECT_EQ(survey()[0].firmware, "W1");
  write(usb / "1-2:1.0/0003:1234:0006.0001/report_descriptor", descriptor(14, 0xAC));
  EXPECT_THAT(only_obstacle().what, HasSubstr("usage"));
  EXPECT_FALSE(survey()[0].usable());
}

TEST_F(Computer, WarnsOfAutosuspendWithoutForbiddingTheDevice) {
  const fs::path usb = add_w2();
  write(usb / "power/control", "auto\n");
  EXPECT_EQ(only_obstacle().kind, "autosuspend");
  EXPECT_FALSE(only_obstacle().blocks);
  EXPECT_THAT(only_obstacle().remedy, HasSubstr("power/control"));
  EXPECT_TRUE(survey()[0].usable());
}

TEST_F(Computer, SaysWhoHasTheInterfaceWhereThereIsNoNode) {
  const fs::path usb = add_usb("1-3", "1234", "0006");
  write(root_ / "dev/bus/usb/001/004", "");
  fs::create_directory_symlink("/sys/bus/usb/drivers/usbfs", usb / "1-3:1.0/driver");
  const Obstacle obstacle = only_obstacle();
  EXPECT_EQ(obstacle.kind, "no node");
  EXPECT_THAT(obstacle.what, HasSubstr("usbfs"));
  EXPECT_TRUE(obstacle.blocks);
}

TEST_F(Computer, FindsAFalconOnUsbfs) {
  add_usb("1-4.1", "0403", "cb48");
  write(root_ / "dev/bus/usb/001/004", "");
  const auto found = survey();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_TRUE(found[0].usable());
  EXPECT_EQ(found[0].bus, "usbfs");
  EXPECT_EQ(found[0].node, "/dev/bus/usb/001/004");
  EXPECT_EQ(found[0].url, "falcon:path=1-4.1");
}

}  // namespace
}  // namespace forcegrid::tools
