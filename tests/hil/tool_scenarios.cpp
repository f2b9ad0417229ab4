// What `forcegrid devices` and `forcegrid doctor` say to the users of a real kernel with udev, and
// whether their advice mends it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr char kRule[] = "/etc/udev/rules.d/70-forcegrid.rules";
constexpr int kNoneUsable = 3;

struct Answer {
  int status = -1;
  json devices;
};

// `forcegrid devices --json` as `user`; the text for people is thrown away.
Answer devices_for(const std::string& user) {
  const ShellResult said = shell("su " + user + " -c 'forcegrid devices --json 2>/dev/null'");
  const json result = json::parse(said.text, nullptr, false);
  EXPECT_FALSE(result.is_discarded()) << said.text;
  return {said.status, result.is_discarded() ? json::array() : result.at("devices")};
}

// The only obstacle of the only device.
json obstacle(const Answer& answer) {
  if (answer.devices.size() != 1 || answer.devices[0].at("obstacles").size() != 1) {
    ADD_FAILURE() << answer.devices.dump(2);
    return {{"kind", ""}, {"what", ""}, {"remedy", ""}};
  }
  return answer.devices[0].at("obstacles")[0];
}

TEST(Tools, DevicesIsReadyForAMemberAndTellsAVisitorWhichGroup) {
  const Bench bench;
  const Answer member = devices_for("operator");
  EXPECT_EQ(member.status, 0);
  ASSERT_EQ(member.devices.size(), 1U);
  EXPECT_EQ(member.devices[0].at("node"), bench.node().dev());
  EXPECT_EQ(member.devices[0].at("url"), "hid:path=" + bench.node().port);
  EXPECT_TRUE(member.devices[0].at("obstacles").empty()) << member.devices.dump(2);
  const Answer visitor = devices_for("visitor");
  EXPECT_EQ(visitor.status, kNoneUsable);
  EXPECT_EQ(obstacle(visitor).at("kind"), "permission");
  EXPECT_EQ(obstacle(visitor).at("remedy"), "sudo usermod -aG plugdev visitor, then log in again");
}

TEST(LongTools, DevicesNamesTheMissingRuleAndDoctorInstallsIt) {
  fs::copy_file(kRule, "/tmp/rule", fs::copy_options::overwrite_existing);
  fs::remove(kRule);
  shell("udevadm control --reload");
  {
    Bench bench;
    const Answer without = devices_for("operator");
    EXPECT_EQ(without.status, kNoneUsable);
    EXPECT_THAT(obstacle(without).at("what").get<std::string>(), HasSubstr("is not installed"));

    // As root; then the device in again, as it says.
    const ShellResult fixed = shell("forcegrid doctor --fix --seconds 0");
    EXPECT_THAT(fixed.text, HasSubstr(std::string("wrote ") + kRule));
    shell("udevadm control --reload");
    EXPECT_THAT(obstacle(devices_for("operator")).at("remedy").get<std::string>(),
                HasSubstr("plug the device in again"));
    bench.unplug(0);
    bench.plug_in("1-1");
    EXPECT_TRUE(eventually([] { return !nodes().empty(); }));
    shell("udevadm settle --timeout=20");
    EXPECT_EQ(devices_for("operator").status, 0);
  }
  fs::copy_file("/tmp/rule", kRule, fs::copy_options::overwrite_existing);
  shell("udevadm control --reload");
}

TEST(LongTools, DevicesNamesTheProcessThatDrivesTheDevice) {
  const Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  Program run = Program::forcegrid(run_arguments(
      "hid:1234:0006", 4.0, forcegrid::testing::fresh_folder("busy"), {"--calibrated"}));
  run.wait_for_line("Simulator: ");
  // By its lock, which any user sees.
  const Answer busy = devices_for("operator");
  EXPECT_EQ(busy.status, kNoneUsable);
  EXPECT_EQ(obstacle(busy).at("kind"), "busy");
  EXPECT_THAT(obstacle(busy).at("what").get<std::string>(), HasSubstr("(forcegrid) drives it"));
  EXPECT_EQ(run.wait(std::chrono::seconds(60)).value_or(-1), 0);
  EXPECT_EQ(devices_for("operator").status, 0);
}

}  // namespace
}  // namespace forcegrid::hil
