// SPDX-License-Identifier: Apache-2.0
#include "tools/unit_profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "profiles/device_profile.h"
#include "tools/atomic_file.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string content(const std::string& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::size_t files_in(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator{}));
}

std::string key_of(const std::string& serial, const std::string& lasting_url) {
  driver::DeviceIdentity identity;
  identity.serial = serial;
  return unit_key(identity, lasting_url);
}

class UnitProfile : public ::testing::Test {
 public:
  ~UnitProfile() override {
    ::unsetenv("XDG_CONFIG_HOME");
    fs::remove_all(folder_);
  }

 protected:
  UnitProfile() {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    ::setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
  }

  const fs::path folder_ =
      fs::path(::testing::TempDir()) / ("unit_profile_" + std::to_string(::getpid()));
  const std::string base_ = profiles::load_device_profile("woodenhaptics_v2015").file;
};

TEST_F(UnitProfile, GoesBySerialWhereThatIsTheUnitsOwnAndByPortWhereAllShareOne) {
  EXPECT_EQ(key_of("1234560", "hid:path=1-2"), "serial-1234560");
  EXPECT_EQ(key_of("0123456789", "hid:path=1-2.4"), "port-1-2.4");
  EXPECT_EQ(key_of("", "falcon:path=3-1"), "port-3-1");
  EXPECT_EQ(key_of("0123456789", "usbip://127.0.0.1:3240/1-1"), "usbip-127.0.0.1-1-1");
  EXPECT_EQ(key_of("FT 1/2", "falcon"), "serial-FT_1_2");
  EXPECT_EQ(key_of("FT000001", "emulated"), "emulated");
}

TEST_F(UnitProfile, IsWrittenWhereItIsFoundWithTheOldOneKept) {
  const std::string file = unit_profile_file("woodenhaptics_v2015", "port-1-2");
  EXPECT_EQ(file, (folder_ / "forcegrid/devices/woodenhaptics_v2015@port-1-2.toml").string());
  EXPECT_FALSE(find_unit_profile("woodenhaptics_v2015", "port-1-2"));
  write_unit_profile(file, base_, "first",
                     {{"dynamics.coulomb_friction_Nm", "[0.01, 0.02, 0.03]"}});
  write_unit_profile(file, base_, "second",
                     {{"motors.torque_constant_Nm_per_A", "[0.025, 0.026, 0.027]"}});
  ASSERT_EQ(find_unit_profile("woodenhaptics_v2015", "port-1-2"), file);
  EXPECT_FALSE(find_unit_profile("woodenhaptics_v2015", "port-1-3"));

  const profiles::DeviceProfile now = profiles::load_device_profile(file);
  EXPECT_EQ(now.motors.torque_constant_Nm_per_A, (profiles::Axes{0.025, 0.026, 0.027}));
  EXPECT_EQ(now.dynamics.coulomb_friction_Nm, (profiles::Axes{0.02, 0.02, 0.02}));
  EXPECT_THAT(content(file), HasSubstr("# second\n"));
  EXPECT_THAT(content(file), HasSubstr("# Lengths, diameters, counts and signs"))
      << "comments stay";
  EXPECT_THAT(content(file + ".old"), HasSubstr("# first\n"));
  EXPECT_EQ(files_in(folder_ / "forcegrid/devices"), 2U) << "nothing temporary is left";
}

TEST_F(UnitProfile, WhatWouldBeNoProfileLeavesTheOldOneAsItWas) {
  const std::string file = unit_profile_file("woodenhaptics_v2015", "port-1-2");
  write_unit_profile(file, base_, "first", {});
  const std::string before = content(file);
  try {
    write_unit_profile(file, base_, "second", {{"motors.torque_constant_Nm_per_A", "[0, 1, 1]"}});
    FAIL() << "a torque constant of zero";
  } catch (const UnitProfileError& error) {
    EXPECT_THAT(error.what(), HasSubstr("torque_constant_Nm_per_A"));
  }
  EXPECT_EQ(content(file), before);
  EXPECT_EQ(files_in(folder_ / "forcegrid/devices"), 1U);
}

TEST_F(UnitProfile, SaysWhichFileCantBeWritten) {
  std::ofstream(folder_ / "file") << "no folder\n";
  try {
    write_unit_profile((folder_ / "file/x.toml").string(), base_, "first", {});
    FAIL() << "a file is no folder";
  } catch (const UnitProfileError& error) {
    EXPECT_THAT(error.what(), HasSubstr((folder_ / "file").string()));
    EXPECT_THAT(error.what(), HasSubstr("name a file elsewhere"));
  }
  EXPECT_THROW(write_unit_profile(unit_profile_file("x", "y"), "/nowhere/x.toml", "z", {}),
               UnitProfileError);
}

TEST_F(UnitProfile, IsReplacedAtOnceForWhoHasTheOldOneOpen) {
  const std::string file = (folder_ / "x").string();
  replace_file(file, "old\n", {});
  std::ifstream open_before(file);
  replace_file(file, "new\n", [&](const std::string& written) {
    EXPECT_EQ(content(written), "new\n");
    EXPECT_EQ(content(file), "old\n") << "not before it was looked at";
  });
  EXPECT_EQ((std::string(std::istreambuf_iterator<char>(open_before), {})), "old\n");
  EXPECT_EQ(content(file), "new\n");
  EXPECT_EQ(content(file + ".old"), "old\n");
}

}  // namespace
}  // namespace forcegrid::tools
