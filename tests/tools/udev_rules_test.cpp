// SPDX-License-Identifier: Apache-2.0
// Which rule of other people lets every account write to a node, in folders of the test's own.
#include "tools/udev_rules.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

class UdevFolders : public ::testing::Test {
 public:
  ~UdevFolders() override { fs::remove_all(root_); }

 protected:
  UdevFolders() {
    for (const std::string& folder : folders_) {
      fs::create_directories(folder);
    }
  }

  void etc(const std::string& name, const std::string& text) const {
    std::ofstream(root_ / "etc" / name) << text;
  }
  void lib(const std::string& name, const std::string& text) const {
    std::ofstream(root_ / "lib" / name) << text;
  }
  /// "99-a.rules:3 MODE=..." or "none"
  std::string found(const RuledNode& node = {"hidraw", "hidraw3", 0x1234, 0x0006}) const {
    const auto rule = rule_that_opens(node, folders_);
    return rule ? fs::path(rule->file).filename().string() + ":" + std::to_string(rule->line) +
                      " " + rule->assignment + (rule->before_ours ? " before" : "")
                : "none";
  }
  /// Whether one line opens the node.
  bool opens(const std::string& line,
             const RuledNode& node = {"hidraw", "hidraw3", 0x1234, 0x0006}) const {
    etc("80-one.rules", line + "\n");
    return found(node) != "none";
  }

  const fs::path root_ = ::testing::TempDir() + "udev_" + std::to_string(::getpid());
  const std::vector<std::string> folders_ = {root_ / "etc", root_ / "lib"};
};

TEST_F(UdevFolders, AreSearchedForLinesThatMatchTheNode) {
  EXPECT_EQ(found(), "none");
  EXPECT_TRUE(opens(R"(KERNEL=="hidraw*", MODE="0666")"));
  EXPECT_TRUE(opens(R"(KERNEL=="hidraw*",MODE="666")"));
  EXPECT_TRUE(opens(R"(SUBSYSTEM=="hidraw", ATTRS{idVendor}=="1234", MODE:="0777")"));
  EXPECT_TRUE(opens(
      R"(SUBSYSTEMS=="usb", ATTRS{idVendor}=="1234", ATTRS{idProduct}=="0006", MODE = "0662")"));
  EXPECT_TRUE(opens(R"(KERNEL=="event*|hidraw*", GROUP="users", MODE="0666", TAG+="uaccess")"));
  EXPECT_TRUE(opens(
      R"(ACTION=="add|change", SUBSYSTEM=="hidraw", ENV{ID_VENDOR_ID}=="12??", MODE="0666")"));
  EXPECT_TRUE(opens(R"(SUBSYSTEM=="hidraw", ATTRS{serial}=="0123456789", MODE="0666")"));
  EXPECT_TRUE(opens(R"(SUBSYSTEM=="hidraw", RUN+="/bin/chmod 666 /dev/%k")"));
  EXPECT_TRUE(opens(R"(SUBSYSTEM=="hidraw", RUN+="/bin/sh -c 'chmod a+rw /dev/%k'")"));

  EXPECT_FALSE(opens(R"(KERNEL=="hidraw*", MODE="0660")"));
  EXPECT_FALSE(opens(R"(KERNEL=="hidraw*", MODE="0664")"));  // to be read by all
  EXPECT_FALSE(opens(R"(KERNEL=="ttyUSB*", MODE="0666")"));
  EXPECT_FALSE(opens(R"(SUBSYSTEM=="usb", ATTR{idVendor}=="1234", MODE="0666")"));
  EXPECT_FALSE(opens(R"(SUBSYSTEM=="hidraw", ATTRS{idVendor}=="046d", MODE="0666")"));
  EXPECT_FALSE(opens(R"(SUBSYSTEM=="hidraw", ATTRS{idProduct}!="0006", MODE="0666")"));
  EXPECT_FALSE(opens(R"(SUBSYSTEM=="hidraw", ACTION=="remove", MODE="0666")"));
  EXPECT_FALSE(opens(R"(# KERNEL=="hidraw*", MODE="0666")"));
  EXPECT_FALSE(opens(R"(KERNEL=="hidraw*", RUN+="/bin/chmod 660 /dev/%k")"));
  EXPECT_FALSE(opens(R"(KERNEL=="hidraw*", RUN+="/bin/chmod u+rw /dev/%k")"));
}

TEST_F(UdevFolders, KnowWhichRulesAreOfAFalconsUsbNode) {
  const RuledNode falcon{"usb", "1-2", 0x0403, 0xcb48};
  EXPECT_TRUE(opens(
      R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="CB48", MODE="0666")", falcon));
  EXPECT_TRUE(opens(R"(SUBSYSTEMS=="usb", ATTRS{idVendor}=="0403", MODE="0666")", falcon));
  EXPECT_FALSE(opens(
      R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="6001", MODE="0666")", falcon));
  EXPECT_FALSE(opens(R"(KERNEL=="hidraw*", MODE="0666")", falcon));
}

TEST_F(UdevFolders, AreReadInTheOrderOfTheNamesAndTheLastCounts) {
  lib("50-a.rules", "KERNEL==\"hidraw*\", MODE=\"0666\"\n");
  EXPECT_EQ(found(), "50-a.rules:1 MODE=\"0666\"");
  etc("99-b.rules", "\n# all\nKERNEL==\"hidraw*\", \\\n  MODE=\"0667\"\n");
  EXPECT_EQ(found(), "99-b.rules:3 MODE=\"0667\"");
  lib("99-b.rules", "KERNEL==\"hidraw*\", MODE=\"0777\"\n");  // hidden by the one in /etc
  EXPECT_EQ(found(), "99-b.rules:3 MODE=\"0667\"");
}

TEST_F(UdevFolders, HoldFinalRulesThatNoLaterOneChanges) {
  lib("60-a.rules", "KERNEL==\"hidraw*\", MODE:=\"0666\"\n");
  etc("99-b.rules", "KERNEL==\"hidraw*\", MODE=\"0666\"\n");
  EXPECT_EQ(found(), "60-a.rules:1 MODE:=\"0666\"");
  etc("05-c.rules", "KERNEL==\"hidraw*\", MODE:=\"0666\"\n");
  EXPECT_EQ(found(), "05-c.rules:1 MODE:=\"0666\" before");
}

TEST_F(UdevFolders, HoldNothingThatOursWouldNotSurvive) {
  fs::copy(FORCEGRID_SOURCE_DIR "/udev/10-forcegrid.rules", root_ / "etc");
  EXPECT_EQ(found(), "none");
}

}  // namespace
}  // namespace forcegrid::tools
