// SPDX-License-Identifier: Apache-2.0
// `forcegrid doctor`: round trips with the far ends, fixing, and its exit statuses.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(30);

json finding(const json& result, const std::string& check) {
  for (const json& one : result.at("findings")) {
    if (one.at("check") == check) {
      return one;
    }
  }
  ADD_FAILURE() << "nothing is said of " << check;
  return {};
}

std::string address_in(const std::string& line) { return line.substr(10, line.find(' ', 10) - 10); }

TEST(DoctorCommand, MeasuresTheRoundTripsOfDeviceAndSimulator) {
  Program emulator = Program::forcegrid(
      {"emulate", "--device", "woodenhaptics_v2015", "--listen", "127.0.0.1:0", "--hand", "none"});
  Program simulator =
      Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string device = "usbip://" + address_in(emulator.wait_for_line("listening ")) + "/1-1";
  const std::string link = address_in(simulator.wait_for_line("listening "));
  Program doctor = Program::forcegrid(
      {"doctor", "--seconds", "0.5", "--device", device, "--simulator", link, "--json"});
  ASSERT_TRUE(doctor.wait(kTimeout).has_value());
  const json result = json::parse(doctor.standard_output());
  for (const char* check : {"USB round trip", "simulator's round trip"}) {
    EXPECT_NE(finding(result, check).at("verdict"), "bad") << check;
    EXPECT_GT(finding(result, check).at("measured").at("round_trips"), 3.0) << check;
    EXPECT_GT(finding(result, check).at("measured").at("p50_us"), 0.0) << check;
  }
  // A full-speed bus moves one report a millisecond each way.
  EXPECT_GT(finding(result, "USB round trip").at("measured").at("max_us"), 500.0);
  for (const char* check : {"wake-up idle", "wake-up under load", "USB round trip"}) {
    const json one = finding(result, check);
    double counted = 0.0;
    for (const json& bin : one.at("histogram")) {
      counted += bin.at("count").get<double>();
    }
    const json& measured = one.at("measured");
    EXPECT_GT(counted, 0.0) << check;
    EXPECT_EQ(counted, measured.value("wakeups", measured.value("round_trips", 0.0))) << check;
  }
}

TEST(DoctorCommand, TellsTheVersionsOfTheProgramAndOfAllItStandsOn) {
  Program doctor = Program::forcegrid({"doctor", "--seconds", "0", "--json"});
  ASSERT_TRUE(doctor.wait(kTimeout).has_value());
  const json result = json::parse(doctor.standard_output());
  const json& versions = result.at("versions");
  const std::string words = finding(result, "versions").at("what");
  for (const char* part : {"forcegrid", "commit", "libusb", "hidapi", "libsodium", "zlib", "HDF5",
                           "glibc", "kernel", "Eigen", "Highway", "CLI11", "compiler"}) {
    ASSERT_TRUE(versions.contains(part)) << part;
    EXPECT_NE(versions.at(part), "") << part;
    EXPECT_THAT(words, HasSubstr(std::string(part) + " " + versions.at(part).get<std::string>()));
  }
  Program version = Program::forcegrid({"--version"});
  ASSERT_EQ(version.wait(kTimeout), 0);
  EXPECT_EQ(version.standard_output(), versions.at("forcegrid").get<std::string>() + ", commit " +
                                           versions.at("commit").get<std::string>() + "\n");
}

TEST(DoctorCommand, FixesWhatItCanAndSaysSo) {
  const std::string root = fresh_folder("doctor");
  std::filesystem::create_directories(root + "/etc/udev/rules.d");
  std::filesystem::create_directories(root + "/sys/devices/system/cpu/cpu0/cpufreq");
  const std::string governor = root + "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
  std::ofstream(governor) << "powersave\n";
  Program before = Program::forcegrid({"doctor", "--root", root, "--seconds", "0"});
  EXPECT_EQ(before.wait(kTimeout), 4);  // no rule
  EXPECT_THAT(before.standard_output(), HasSubstr("fix:"));
  Program fix = Program::forcegrid({"doctor", "--root", root, "--seconds", "0", "--fix", "--json"});
  ASSERT_TRUE(fix.wait(kTimeout).has_value());
  const json result = json::parse(fix.standard_output());
  EXPECT_EQ(finding(result, "udev rule").at("verdict"), "good");
  EXPECT_EQ(finding(result, "CPU governor").at("verdict"), "good");
  EXPECT_THAT(result.at("fixed").dump(), HasSubstr("10-forcegrid.rules"));
  EXPECT_THAT(result.at("fixed").dump(), HasSubstr("scaling_governor"));
  std::ifstream written(governor);
  std::string word;
  written >> word;
  EXPECT_EQ(word, "performance");
}

TEST(DoctorCommand, TellsEverythingElseWhereADeviceCantBeOpened) {
  Program doctor =
      Program::forcegrid({"doctor", "--seconds", "0.1", "--device", "hid:/dev/no-such-node",
                          "--simulator", "127.0.0.1:0", "--json"});
  EXPECT_EQ(doctor.wait(kTimeout), 4);
  const json result = json::parse(doctor.standard_output());
  const json device = finding(result, "USB round trip");
  EXPECT_EQ(device.at("verdict"), "bad");
  EXPECT_THAT(device.at("what").get<std::string>(), HasSubstr("/dev/no-such-node"));
  EXPECT_NE(device.at("remedy"), "");
  EXPECT_EQ(finding(result, "simulator's round trip").at("verdict"), "bad");  // no such port
  EXPECT_EQ(finding(result, "wake-up under load").at("histogram").empty(), false);
}

TEST(DoctorCommand, SaysThatNoSimulatorAnswers) {
  Program doctor =
      Program::forcegrid({"doctor", "--seconds", "0.1", "--simulator", "127.0.0.1:9", "--json"});
  EXPECT_EQ(doctor.wait(kTimeout), 4);
  const json result = json::parse(doctor.standard_output());
  EXPECT_EQ(finding(result, "simulator's round trip").at("verdict"), "bad");
  EXPECT_THAT(finding(result, "simulator's round trip").at("remedy").get<std::string>(),
              HasSubstr("forcegrid simulate --listen 127.0.0.1:9"));
}

// A device with a serial number on a host with a name, below a folder with another.
TEST(DoctorCommand, WritesAReportWithoutAnythingPrivate) {
  namespace fs = std::filesystem;
  const std::string root = fresh_folder("doctor_report/of_babbage");
  const std::string usb = root + "/sys/devices/usb1/1-2";
  const std::string hid = usb + "/1-2:1.0/0003:1234:0006.0001";
  for (const std::string& folder :
       {hid, root + "/sys/bus/usb/devices", root + "/sys/class/hidraw/hidraw0", root + "/dev",
        root + "/etc", root + "/proc/sys/kernel"}) {
    fs::create_directories(folder);
  }
  for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
           {"idVendor", "1234"},
           {"idProduct", "0006"},
           {"manufacturer", "mbed.org"},
           {"product", "HID DEVICE No. SN-778899"},
           {"serial", "SN-778899"},
           {"speed", "12"},
           {"descriptors", "eighteen bytes and more"}}) {
    std::ofstream(usb + "/" + name) << text << "\n";
  }
  std::ofstream(hid + "/uevent") << "HID_ID=0003:00001234:00000006\nHID_NAME=x\n";
  std::ofstream(hid + "/report_descriptor") << "not one of ours";
  std::ofstream(root + "/dev/hidraw0") << "";
  std::ofstream(root + "/etc/hostname") << "engine-room.example.org\n";
  std::ofstream(root + "/proc/sys/kernel/hostname") << "engine-room\n";
  fs::create_directory_symlink(hid, root + "/sys/class/hidraw/hidraw0/device");
  fs::create_directory_symlink(usb, root + "/sys/bus/usb/devices/1-2");
  const std::string file = root + "/report.md";
  Program doctor = Program::forcegrid({"doctor", "--root", root, "--seconds", "0.1", "--device",
                                       "usbip://lovelace:1/1-1", "--simulator", "127.0.0.1:9",
                                       "--report", file});
  EXPECT_EQ(doctor.wait(kTimeout), 4);
  EXPECT_THAT(doctor.standard_output(), HasSubstr("Wrote " + file));
  std::ifstream stream(file);
  const std::string report{std::istreambuf_iterator<char>(stream), {}};
  for (const char* said : {"### 1234:0006", "SHA-256", "HID DEVICE No. (serial)", "wake-up idle",
                           "| kernel |", "____", "descriptor, blocks"}) {
    EXPECT_THAT(report, HasSubstr(said));
  }
  std::array<char, 256> host{};
  ASSERT_EQ(gethostname(host.data(), host.size() - 1), 0);
  for (const std::string& secret :
       {std::string("778899"), std::string("engine-room"), std::string("babbage"),
        std::string("lovelace"), std::string("127.0.0.1"), std::string(host.data())}) {
    EXPECT_EQ(report.find(secret), std::string::npos) << secret;
  }
}

TEST(DoctorCommand, RefusesAReportThatCantBeWrittenBeforeItMeasures) {
  Program doctor = Program::forcegrid({"doctor", "--report", "/no-such-folder/report.md"});
  EXPECT_EQ(doctor.wait(std::chrono::seconds(3)), 1);
  EXPECT_THAT(doctor.standard_error(), HasSubstr("--report /no-such-folder/report.md"));
}

}  // namespace
}  // namespace forcegrid
