// SPDX-License-Identifier: Apache-2.0
// `forcegrid calibrate` through the driver and the emulated devices' USB.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "profiles/device_profile.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(150);

// A server of one emulated device, and what its motors did.
class Emulator {
 public:
  explicit Emulator(std::vector<std::string> arguments)
      : program_(Program::forcegrid(with_address(std::move(arguments)))) {
    const std::string line = program_.wait_for_line("listening ");
    url_ = "usbip://" + line.substr(10, line.find(' ', 10) - 10) + "/1-1";
  }
  const std::string& url() const { return url_; }
  json report() {
    program_.send_signal(SIGINT);
    EXPECT_TRUE(program_.wait(kTimeout).has_value());
    const std::string text = program_.standard_output();
    return json::parse(text.substr(text.find('{')));
  }

 private:
  static std::vector<std::string> with_address(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "emulate");
    arguments.insert(arguments.end(), {"--listen", "127.0.0.1:0", "--json"});
    return arguments;
  }

  Program program_;
  std::string url_;
};

class CalibrateCommand : public ::testing::Test {
 public:
  ~CalibrateCommand() override { ::unsetenv("XDG_CONFIG_HOME"); }

 protected:
  CalibrateCommand() : folder_(fresh_folder("calibrate")) {
    ::setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
  }

  bool anything_written() const { return fs::exists(folder_ + "/forcegrid/devices"); }

  // A copy of the device's profile with other numbers in lines that begin with the keys.
  std::string believed(const std::string& device,
                       const std::vector<std::pair<std::string, std::string>>& lines) const {
    std::ifstream shipped(profiles::load_device_profile(device).file);
    const std::string file = folder_ + "/believed.toml";
    std::ofstream copy(file);
    for (std::string line; std::getline(shipped, line);) {
      for (const auto& [key, value] : lines) {
        if (line.starts_with(key + " =")) {
          line = key + " = " + value;
        }
      }
      copy << line << '\n';
    }
    return file;
  }

  const std::string folder_;
};

// A light, balanced arm, so that a host that pauses does not let it fall.
TEST_F(CalibrateCommand, RecoversAWrongProfileAndRunTakesWhatItWrote) {
  const auto reference = profiles::load_device_profile("phantom_desktop");
  Emulator emulator(
      {"--device", "phantom_desktop", "--hand", "none", "--calibrated", "--tip-mass", "0.03"});
  const std::string profile =
      believed("phantom_desktop", {{"torque_constant_Nm_per_A", "[0.0281, 0.0187, 0.0281]"},
                                   {"coulomb_friction_Nm", "[0.004, 0.016, 0.006]"}});
  Program calibrate = Program::forcegrid(
      {"calibrate", "--device", emulator.url(), "--profile", profile, "--calibrated", "--tip-mass",
       "0.03", "--no-range", "--quick", "--yes", "--let-go-s", "0", "--json"});
  ASSERT_EQ(calibrate.wait(kTimeout), 0) << calibrate.standard_error();
  const json result = json::parse(calibrate.standard_output());
  EXPECT_TRUE(result.at("passed"));
  EXPECT_TRUE(result.at("absolute"));
  EXPECT_TRUE(result.at("zero_current_delivered"));
  EXPECT_EQ(result.at("unit"), "serial-PHANTOM-0001");
  EXPECT_LT(result.at("largest_tip_speed_m_per_s"), 0.6 * reference.limits.max_speed_m_per_s);

  const std::string file = result.at("written");
  EXPECT_EQ(file, folder_ + "/forcegrid/devices/phantom_desktop@serial-PHANTOM-0001.toml");
  const auto written = profiles::load_device_profile(file);
  for (std::size_t i = 0; i < 3; ++i) {
    SCOPED_TRACE("joint " + std::to_string(i));
    EXPECT_NEAR(
        written.motors.torque_constant_Nm_per_A[i] / reference.motors.torque_constant_Nm_per_A[i],
        1.0, 0.03);
    EXPECT_NEAR(written.dynamics.coulomb_friction_Nm[i] / reference.dynamics.coulomb_friction_Nm[i],
                1.0, 0.10);
  }

  Program run =
      Program::forcegrid({"run", "--device", emulator.url(), "--profile", "phantom_desktop",
                          "--calibrated", "--scene", "small", "--no-motor-check", "--seconds",
                          "0.5", "--no-reference", "--out", folder_ + "/out"});
  ASSERT_TRUE(run.wait(kTimeout).has_value());
  EXPECT_THAT(run.standard_output(), HasSubstr("Calibrated profile of this unit: " + file));
  Program without = Program::forcegrid({"run", "--device", emulator.url(), "--profile",
                                        "phantom_desktop", "--calibrated", "--scene", "small",
                                        "--no-motor-check", "--seconds", "0.5", "--no-reference",
                                        "--calibration", "none", "--out", folder_ + "/out"});
  ASSERT_TRUE(without.wait(kTimeout).has_value());
  EXPECT_THAT(without.standard_output(), Not(HasSubstr("Calibrated profile")));
}

TEST_F(CalibrateCommand, HomesAndNamesTheMotorThatPushesTheWrongWay) {
  Emulator emulator({"--device", "woodenhaptics_v2015", "--hand", "firm", "--let-go",
                     "--random-counters", "--fault", "wrong-way-motor:axis=b"});
  Program calibrate =
      Program::forcegrid({"calibrate", "--device", emulator.url(), "--yes", "--json"});
  ASSERT_EQ(calibrate.wait(kTimeout), 3) << calibrate.standard_error();
  const json result = json::parse(calibrate.standard_output());
  EXPECT_FALSE(result.at("passed"));
  EXPECT_TRUE(result.at("checks").at(0).at("passed"));
  EXPECT_EQ(result.at("checks").at(1).at("check"), "direction of joint b (shoulder)");
  EXPECT_FALSE(result.at("checks").at(1).at("passed"));
  EXPECT_THAT(result.at("checks").at(1).at("what").get<std::string>(), HasSubstr("swap"));
  EXPECT_TRUE(result.at("written").is_null());
  EXPECT_EQ(result.at("unit"), "usbip-127.0.0.1-1-1") << "its serial is that of all of its kind";
  EXPECT_FALSE(anything_written());
  const json report = emulator.report();
  EXPECT_EQ(report.at("counters_loaded"), 1);
  EXPECT_EQ(report.at("final_current_mA"), (std::array<double, 3>{}));
}

TEST_F(CalibrateCommand, CtrlCEndsItWithZeroCurrentAndNothingWritten) {
  Emulator emulator({"--device", "phantom_desktop", "--hand", "none", "--calibrated"});
  Program calibrate =
      Program::forcegrid({"calibrate", "--device", emulator.url(), "--profile", "phantom_desktop",
                          "--calibrated", "--no-range", "--yes", "--let-go-s", "0"});
  ASSERT_TRUE(calibrate.wait_for_text("makes its strokes"));
  calibrate.send_signal(SIGINT);
  EXPECT_EQ(calibrate.wait(kTimeout), 130);
  EXPECT_THAT(calibrate.standard_error(), HasSubstr("stopped"));
  EXPECT_FALSE(anything_written());
  const json report = emulator.report();
  EXPECT_EQ(report.at("final_current_mA"), (std::array<double, 3>{}));
  EXPECT_EQ(report.at("watchdog_trips"), 0) << "the host itself wrote zero";
}

TEST_F(CalibrateCommand, AsksNobodyWhereNobodyIs) {
  Program calibrate = Program::forcegrid({"calibrate", "--device", "usbip://127.0.0.1:9/1-1"});
  EXPECT_EQ(calibrate.wait(kTimeout), 1);
  EXPECT_THAT(calibrate.standard_error(), HasSubstr("--yes"));
}

}  // namespace
}  // namespace forcegrid
