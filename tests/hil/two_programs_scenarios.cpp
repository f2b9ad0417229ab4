// SPDX-License-Identifier: Apache-2.0
// A second program on the device: it has the node open, it commands the motors, it takes the
// interface, or another vendor's udev rule lets everybody in.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/hil/hil_bench.h"
#include "tests/hil/open_node.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr char kUrl[] = "hid:1234:0006";

std::string usb_node(const Node& node) {
  const std::string usb = "/sys/bus/usb/devices/" + node.port;
  char name[64];
  std::snprintf(name, sizeof name, "/dev/bus/usb/%03d/%03d", std::stoi(first_line(usb + "/busnum")),
                std::stoi(first_line(usb + "/devnum")));
  return name;
}

TEST(LongTwoPrograms, TheOneThatHasTheNodeOpenIsNamedAndNoMotorMovesUnlessShared) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  {
    const OpenNode other(bench.node().dev());
    const EndedRun refused = run(kUrl, 1.0, {"--calibrated"});
    EXPECT_EQ(refused.status, 1) << refused.text;
    EXPECT_THAT(refused.text,
                AllOf(HasSubstr("this device is in use by process " + std::to_string(::getpid())),
                      HasSubstr("or use --share if it only listens")));
    const EndedRun shared = run(kUrl, 1.0, {"--calibrated", "--share"});
    EXPECT_EQ(shared.status, 0) << shared.text;
    // A member of plugdev may not look at root's processes, and is told so.
    const ShellResult member = shell(
        "su operator -c 'forcegrid run --device hid:1234:0006 --calibrated --device-timeout-ms 400 "
        "--no-reference --seconds 0.5 --out /tmp/out-operator --scene " +
        tiny_scene() + "'");
    EXPECT_EQ(member.status, 0) << member.text;
    EXPECT_THAT(member.text, HasSubstr("processes of other users can't be looked at"));
  }
  EXPECT_EQ(run(kUrl, 1.0, {"--calibrated"}).status, 0);
}

TEST(LongTwoPrograms, ASecondThatCommandsTheDeviceEndsTheRun) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const OpenNode other(bench.node().dev());
  std::atomic<bool> ended{false};
  std::thread commands([&] {
    const char zero[15] = {};  // no report ID, no current
    std::this_thread::sleep_for(std::chrono::seconds(3));
    while (!ended) {
      static_cast<void>(!::write(other.get(), zero, sizeof zero));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const EndedRun felt = run(kUrl, 30.0, {"--calibrated", "--share"});
  ended = true;
  commands.join();
  EXPECT_EQ(felt.status, 1) << felt.text;
  EXPECT_THAT(felt.text, HasSubstr("Another program commands the device at the same time"));
  EXPECT_EQ(felt.summary.at("faults").at(0).at("name"), "second_writer");
  const nlohmann::json emulator = bench.end();
  for (const auto& current : emulator.at("final_current_mA")) {
    EXPECT_EQ(current.get<double>(), 0.0);
  }
}

TEST(LongTwoPrograms, ADeviceWhoseInterfaceOneTakesIsNotCalledUnplugged) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const OpenNode usb(usb_node(bench.node()));
  std::thread taker([&] {
    std::this_thread::sleep_for(std::chrono::seconds(4));
    usbdevfs_disconnect_claim claim{};  // as libusb_detach_kernel_driver and libusb_claim_interface
    EXPECT_EQ(::ioctl(usb.get(), USBDEVFS_DISCONNECT_CLAIM, &claim), 0) << std::strerror(errno);
  });
  const EndedRun felt = run(kUrl, 30.0, {"--calibrated"});
  taker.join();
  EXPECT_EQ(felt.status, 1) << felt.text;
  EXPECT_EQ(felt.summary.at("faults").at(0).at("name"), "interface_taken") << felt.text;
  EXPECT_THAT(felt.text,
              AllOf(HasSubstr("Another program took the device, which is still connected"),
                    HasSubstr("is still at USB port " + bench.node().port),
                    HasSubstr("driver usbfs has its interface")));
  EXPECT_THAT(felt.text, ::testing::Not(HasSubstr("check the cable")));
}

/// A rule of another vendor for as long as it lives.
class VendorRule {
 public:
  VendorRule(const std::string& name, const std::string& text)
      : file_("/etc/udev/rules.d/" + name) {
    std::ofstream(file_) << text << '\n';
    shell("udevadm control --reload");
  }
  ~VendorRule() {
    fs::remove(file_);
    shell("udevadm control --reload");
  }
  VendorRule(const VendorRule&) = delete;
  VendorRule& operator=(const VendorRule&) = delete;

 private:
  std::string file_;
};

unsigned mode_of(const std::string& node) {
  struct stat status {};
  EXPECT_EQ(::stat(node.c_str(), &status), 0) << node;
  return status.st_mode & 07777;
}

TEST(LongTwoPrograms, ARuleThatOpensEveryNodeLosesToOursUnlessItIsFinalAndIsNamedThen) {
  constexpr char kAll[] = "SUBSYSTEM==\"hidraw\", MODE=\"0666\"";
  {
    const VendorRule before("05-vendor.rules", kAll);
    const VendorRule after("99-vendor.rules",
                           "KERNEL==\"hidraw*\", GROUP=\"users\", MODE:=\"0666\"");
    const Bench bench;
    EXPECT_EQ(mode_of(bench.node().dev()), 0660U);
    EXPECT_EQ(ask("operator", "devices").status, 0);
  }
  {
    const VendorRule final_one("05-vendor.rules", "SUBSYSTEM==\"hidraw\", MODE:=\"0666\"");
    const Bench bench;
    EXPECT_EQ(mode_of(bench.node().dev()), 0666U);
    const nlohmann::json open = obstacle(ask("operator", "devices"));
    EXPECT_EQ(open.at("kind"), "open to all");
    EXPECT_EQ(open.at("blocks"), false);
    EXPECT_THAT(open.at("what").get<std::string>(),
                HasSubstr("/etc/udev/rules.d/05-vendor.rules:1 does that"));
    EXPECT_THAT(open.at("remedy").get<std::string>(), HasSubstr("no later rule can undo it"));
  }
  {
    const RuleTakenAway before_installation;
    const VendorRule vendor("99-vendor.rules", kAll);
    const Bench bench;
    EXPECT_EQ(mode_of(bench.node().dev()), 0666U);
    EXPECT_THAT(obstacle(ask("operator", "devices")).at("remedy").get<std::string>(),
                HasSubstr("it is final, so that line has no effect then"));
  }
}

}  // namespace
}  // namespace forcegrid::hil
