// SPDX-License-Identifier: Apache-2.0
// `forcegrid doctor` beside a device on a real kernel with udev: each advice is followed to the
// letter, and must make its finding go away.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/hil/hil_bench.h"
#include "tests/hil/tool_answers.h"

namespace forcegrid::hil {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr char kLimits[] = "/etc/security/limits.d/95-forcegrid.conf";
constexpr char kLook[] = "doctor --seconds 0";  // no measurements
constexpr int kBad = 4;

void follow(const std::string& command) {
  const ShellResult done = shell(command);
  EXPECT_EQ(done.status, 0) << command << ": " << done.text;
}

std::string remedy_of(const Answer& answer, const std::string& check) {
  return finding(answer, check).at("remedy").get<std::string>();
}

std::string verdict_of(const Answer& answer, const std::string& check) {
  return finding(answer, check).at("verdict").get<std::string>();
}

// A full-speed bus moves a report each way in a frame of 1 ms.
TEST(LongDoctor, MeasuresTheRoundTripOfADeviceOnHidraw) {
  const Bench bench;
  const Answer answer =
      ask("operator", "doctor --seconds 1 --device hid:path=" + bench.node().port);
  const json trip = finding(answer, "USB round trip");
  EXPECT_EQ(trip.at("verdict"), "good") << trip.dump(2);
  EXPECT_GT(trip.at("measured").at("round_trips"), 100.0);
  EXPECT_GT(trip.at("measured").at("p50_us"), 200.0);
  EXPECT_LT(trip.at("measured").at("p50_us"), 2000.0);
  double counted = 0.0;
  for (const json& bin : trip.at("histogram")) {
    counted += bin.at("count").get<double>();
  }
  EXPECT_EQ(counted, trip.at("measured").at("round_trips"));
  measured("usb_round_trip_p50", trip.at("measured").at("p50_us").get<double>(), "us");
}

TEST(LongDoctor, TellsAVisitorWhyNotAndItsAdviceLetsThemIn) {
  const Bench bench;
  const std::string device = "device at " + bench.node().port;
  const std::string command = "doctor --seconds 0.2 --device hid:1234:0006";
  const Answer before = ask("visitor", command);
  EXPECT_EQ(before.status, kBad);
  EXPECT_EQ(verdict_of(before, "USB round trip"), "bad");
  EXPECT_THAT(finding(before, "USB round trip").at("what").get<std::string>(),
              HasSubstr("Permission denied"));
  EXPECT_EQ(verdict_of(before, device), "bad");
  fs::copy_file("/etc/group", "/tmp/group", fs::copy_options::overwrite_existing);
  follow(command_in(remedy_of(before, device)));
  const Answer after = ask("visitor", command);  // which logs in again
  fs::copy_file("/tmp/group", "/etc/group", fs::copy_options::overwrite_existing);
  EXPECT_EQ(verdict_of(after, device), "good");
  EXPECT_EQ(verdict_of(after, "USB round trip"), "good");
  EXPECT_EQ(verdict_of(ask("visitor", kLook), device), "bad");
}

TEST(LongDoctor, ItsCommandForALostRuleMakesTheDeviceUsable) {
  const std::string source = "/tmp/source/udev/10-forcegrid.rules";
  fs::create_directories(fs::path(source).parent_path());
  fs::copy_file(kRule, source, fs::copy_options::overwrite_existing);
  fs::remove(kRule);
  shell("udevadm control --reload");
  {
    Bench bench;
    const std::string remedy = remedy_of(ask("operator", kLook), "udev rule");
    const std::string begin = "(or: ";
    const std::size_t at = remedy.find(begin);
    ASSERT_NE(at, std::string::npos) << remedy;
    const std::size_t from = at + begin.size();
    follow("cd /tmp/source && " + remedy.substr(from, remedy.find(')', from) - from));
    EXPECT_THAT(remedy, HasSubstr("then plug the device in again"));
    bench.unplug(0);
    bench.plug_in("1-1");
    EXPECT_TRUE(eventually([] { return !nodes().empty(); }));
    shell("udevadm settle --timeout=20");
    EXPECT_EQ(verdict_of(ask("operator", kLook), "udev rule"), "good");
    EXPECT_EQ(ask("operator", "devices").status, 0);
  }
  fs::copy_file(source, kRule, fs::copy_options::overwrite_existing);
  shell("udevadm control --reload");
}

TEST(LongDoctor, ItsCommandAndItsFixEndAutosuspend) {
  const Bench bench;
  const std::string device = "device at " + bench.node().port;
  const std::string control = "/sys/bus/usb/devices/" + bench.node().port + "/power/control";
  const auto spoil = [&] { std::ofstream(control) << "auto\n"; };
  spoil();
  const Answer before = ask("operator", kLook);
  EXPECT_EQ(verdict_of(before, device), "warning");
  follow(command_in(remedy_of(before, device)));
  EXPECT_EQ(first_line(control), "on");
  EXPECT_EQ(verdict_of(ask("operator", kLook), device), "good");
  spoil();
  EXPECT_EQ(verdict_of(ask("root", std::string(kLook) + " --fix"), device), "good");
  EXPECT_EQ(first_line(control), "on");
}

TEST(LongDoctor, TheProcessThatDevicesAdvisesToEndIsTheOneThatDrivesTheDevice) {
  const Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  Program run = Program::forcegrid(run_arguments(
      "hid:1234:0006", 60.0, forcegrid::testing::fresh_folder("busy"), {"--calibrated"}));
  run.wait_for_line("Simulator: ");
  const Answer busy = ask("operator", "devices");
  EXPECT_EQ(busy.status, kNoneUsable);
  EXPECT_EQ(
      verdict_of(ask("operator", "doctor --seconds 0.1 --device hid:1234:0006"), "USB round trip"),
      "bad");
  const std::string remedy = obstacle(busy).at("remedy").get<std::string>();
  const std::size_t at = remedy.find("kill ");
  ASSERT_NE(at, std::string::npos) << remedy;
  follow(remedy.substr(at, remedy.find(')', at) - at));
  EXPECT_TRUE(run.wait(std::chrono::seconds(20)).has_value()) << "it runs on";
  EXPECT_EQ(ask("operator", "devices").status, 0);
}

// The guest has no PAM; its part, giving the file's limits to a member's next session, is done by
// the shell.
TEST(LongDoctor, ItsCommandForLimitsGrantsPriorityAndMemory) {
  const Answer before = ask("operator", kLook);
  EXPECT_EQ(verdict_of(before, "real-time priority"), "bad");
  EXPECT_NE(verdict_of(before, "locked memory"), "good");
  const std::string remedy = remedy_of(before, "real-time priority");
  EXPECT_EQ(remedy, remedy_of(before, "locked memory"));
  follow(command_in(remedy));
  std::string limits;
  std::ifstream stream(kLimits);
  for (std::string who, type, item, value; stream >> who >> type >> item >> value;) {
    EXPECT_EQ(who, "@plugdev");
    EXPECT_EQ(type, "-");  // soft and hard
    EXPECT_TRUE(item == "rtprio" || item == "memlock") << item;
    limits += std::string("ulimit ") + (item == "rtprio" ? "-r " : "-l ") + value + " && ";
  }
  const Answer after = ask("operator", kLook, limits);
  EXPECT_EQ(verdict_of(after, "real-time priority"), "good") << limits;
  EXPECT_EQ(verdict_of(after, "locked memory"), "good") << limits;
  fs::remove(kLimits);
}

}  // namespace
}  // namespace forcegrid::hil
