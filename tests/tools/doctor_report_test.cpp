// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kSerial[] = "SN-778899";

// A computer in a folder, with a device whose serial number is also in its name.
class ReportOfAComputer : public ::testing::Test {
 public:
  ~ReportOfAComputer() override { fs::remove_all(root_); }

 protected:
  ReportOfAComputer()
      : root_(::testing::TempDir() + "report_" + std::to_string(getpid())),
        usb_(root_ / "sys/bus/usb/devices/1-2") {
    fs::remove_all(root_);
    system_.roots.sysfs = root_ / "sys";
    system_.roots.dev = root_ / "dev";
    system_.roots.proc = root_ / "proc";
    system_.etc = root_ / "etc";
    system_.user.name = "ada";
    fs::create_directories(usb_);
    fs::create_directories(root_ / "etc");
    fs::create_directories(root_ / "proc/sys/kernel");
    std::ofstream(root_ / "etc/hostname") << "engine-room.example.org\n";
    std::ofstream(root_ / "proc/sys/kernel/hostname") << "engine-room\n";
    std::ofstream(usb_ / "descriptors") << "abc";
    std::ofstream(usb_ / "speed") << "12\n";
    device_.bus = "usbfs";
    device_.node = "/dev/bus/usb/001/004";
    device_.port_path = "1-2";
    device_.vendor_id = 0x0403;
    device_.product_id = 0xCB48;
    device_.manufacturer = "ADA's workshop";
    device_.product = std::string("Falcon ") + kSerial;
    device_.serial = kSerial;
    device_.firmware = "Falcon";
    device_.obstacles = {{"busy", true, "process 4711 (ada-tool) drives it", "kill 4711"}};
    content_.devices = {device_};
    content_.versions = {{"kernel", "Linux 6.1 built by ada@engine-room"}};
    content_.findings = {
        {.check = "group plugdev",
         .verdict = Verdict::kWarn,
         .what = "ada is not in group plugdev",
         .remedy = "sudo usermod -aG plugdev ada"},
        {.check = "udev rule", .what = (root_ / "etc/udev/rules.d/x.rules").string() + " is old"},
        {.check = "device at 1-2", .what = "process 4711 (ada-tool) drives it"},
        {.check = "USB round trip",
         .verdict = Verdict::kBad,
         .what = "no Falcon with serial " + std::string(kSerial) + " on lovelace"},
        {.check = "wake-up idle",
         .what = "p99.9 12 us",
         .measured = {{"p50_us", 9.0}},
         .histogram = {{10.0, 500}}}};
  }

  std::string report() const {
    return doctor_report(content_, system_.roots,
                         private_words(system_, root_.string(), content_.devices));
  }

  fs::path root_;
  fs::path usb_;
  DoctorSystem system_;
  FoundDevice device_;
  ReportContent content_;
};

TEST_F(ReportOfAComputer, HasNothingPrivateInIt) {
  const std::string text = report();
  for (const char* secret : {"ada ", "ada@", "ADA", "ada-tool", "4711", "engine-room",
                             "example.org", kSerial, "778899", "lovelace"}) {
    EXPECT_THAT(text, Not(HasSubstr(secret)));
  }
  EXPECT_THAT(text, Not(HasSubstr(root_.string())));
}

TEST_F(ReportOfAComputer, HasWhatTheProjectNeeds) {
  const std::string text = report();
  for (const char* said :
       {"0403:cb48", "(user)'s workshop Falcon (serial)", "(user) is not in group plugdev",
        "(root)/etc/udev/rules.d/x.rules is old", "busy, blocks", "p50_us", "<=     10 us      500",
        // "abc" of FIPS 180-2, appendix B.1
        "3 bytes, SHA-256 ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        "has a serial number | yes (left out)", "against a ruler", "____"}) {
    EXPECT_THAT(text, HasSubstr(said));
  }
}

TEST_F(ReportOfAComputer, KnowsTheNamesOfThisComputerToo) {
  setenv("SUDO_USER", "byron", 1);
  const PrivateWords words = private_words(system_, "", {});
  unsetenv("SUDO_USER");
  EXPECT_EQ(words.at("ada"), "(user)");
  EXPECT_EQ(words.at("byron"), "(user)");
  EXPECT_EQ(words.at("engine-room.example.org"), "(host)");
  EXPECT_EQ(words.at("engine-room"), "(host)");
  char host[256] = {};
  ASSERT_EQ(gethostname(host, sizeof host - 1), 0);
  EXPECT_TRUE(words.contains(host) || std::string(host) == "localhost") << host;
  EXPECT_FALSE(words.contains("root"));
}

TEST(PrivateWords, AreReplacedAsWordsOnly) {
  const PrivateWords words{{"ada", "(user)"}, {"/home/ada", "(home)"}};
  EXPECT_EQ(without_private_words("Ada, /home/ada/x, adaptive, canada, ada_1, ada", words),
            "(user), (home)/x, adaptive, canada, (user)_1, (user)");
  EXPECT_EQ(without_private_words("", words), "");
}

}  // namespace
}  // namespace forcegrid::tools
