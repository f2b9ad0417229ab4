// SPDX-License-Identifier: Apache-2.0
// The main job on an emulated Novint Falcon, from power-on: firmware, homing, the block.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

json parsed(const std::string& text) {
  const json result = json::parse(text, nullptr, false);
  EXPECT_FALSE(result.is_discarded()) << text;
  return result.is_discarded() ? json::object() : result;
}

/// The fact sheet's image with one block of two words.
std::string firmware_file() {
  std::vector<unsigned char> image = {0xAA, 0x08};
  image.resize(18, 0x00);
  for (const int byte : {0x3F, 0x00, 0x02, 0x80, 0x02, 0x00, 0x3F, 0x00, 0x00, 0x80, 0x34, 0x12,
                         0x78, 0x56, 0x00, 0x00}) {
    image.push_back(static_cast<unsigned char>(byte));
  }
  const std::string file = fresh_folder("falcon_firmware") + "/firmware.bin";
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(image.data()),
             static_cast<std::streamsize>(image.size()));
  return file;
}

TEST(FalconJob, FeelsTheSmallBlockFromPowerOn) {
  Program run = Program::forcegrid({"run", "--device", "emulated:falcon", "--scene", "small",
                                    "--seconds", "5", "--out", fresh_folder("falcon"), "--json"});
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  EXPECT_THAT(run.standard_error(), HasSubstr("sending firmware 'synthetic image"));
  EXPECT_THAT(run.standard_error(), HasSubstr("Pull the knob"));
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("profile"), "falcon");
  EXPECT_TRUE(summary.at("faults").empty());
  EXPECT_TRUE(summary.at("zero_current_delivered").get<bool>());
  EXPECT_GT(summary.at("force_rms_N").get<double>(), 0.05);
  EXPECT_EQ(summary.at("reference"), "computed");
  EXPECT_TRUE(summary.at("rms_error_percent").contains("forcegrid"));
  const json& emulator = summary.at("emulator");
  EXPECT_EQ(emulator.at("firmware_bytes_loaded"), 24);
  EXPECT_EQ(emulator.at("firmware_starts"), 1);
  EXPECT_EQ(emulator.at("malformed_packets"), 0);
  EXPECT_EQ(emulator.at("final_command"), (json{0, 0, 0}));
  EXPECT_GT(emulator.at("max_abs_command")[0].get<int>(), 20);  // it was felt
}

TEST(FalconJob, TakesTheUsersFirmwareAndMeetsItAgain) {
  const std::string image = firmware_file();
  Program emulator =
      Program::forcegrid({"emulate", "--device", "falcon", "--listen", "127.0.0.1:0", "--json"});
  const std::string line = emulator.wait_for_line("listening ");
  const std::string url = "usbip://" + line.substr(10, line.find(' ', 10) - 10) + "/1-1";
  const auto run = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments = {
        "run",   "--device",  url, "--profile",      "falcon", "--scene",
        "small", "--seconds", "1", "--no-reference", "--out",  fresh_folder("falcon_again"),
        "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Program::forcegrid(arguments);
  };
  Program without = run({});
  EXPECT_EQ(without.wait(), 1);
  EXPECT_THAT(without.standard_error(), HasSubstr("no firmware runs in it"));
  EXPECT_THAT(without.standard_error(), HasSubstr("--firmware FILE"));

  Program with = run({"--firmware", image});
  EXPECT_EQ(with.wait(), 0) << with.standard_error();
  EXPECT_THAT(with.standard_error(), HasSubstr("sending firmware '" + image + "' (34 bytes)"));

  Program again = run({});  // it still runs, and knows where its axes are
  EXPECT_EQ(again.wait(), 0) << again.standard_error();
  EXPECT_THAT(again.standard_error(), Not(HasSubstr("sending firmware")));
  EXPECT_THAT(again.standard_error(), Not(HasSubstr("Pull the knob")));
}

TEST(FalconJob, ComplainsAboutFirmwareThatIsMissingOrNotWanted) {
  Program missing =
      Program::forcegrid({"run", "--device", "falcon", "--firmware", "/nowhere/fw.bin"});
  EXPECT_EQ(missing.wait(), 1);
  EXPECT_THAT(missing.standard_error(), HasSubstr("'/nowhere/fw.bin': there is no such file"));
  EXPECT_THAT(missing.standard_error(), HasSubstr("libnifalcon"));

  Program unwanted = Program::forcegrid({"run", "--firmware", firmware_file()});
  EXPECT_EQ(unwanted.wait(), 1);
  EXPECT_THAT(unwanted.standard_error(), HasSubstr("keeps its firmware"));
}

TEST(FalconJob, RefusesATruncatedImageBeforeAByteIsSent) {
  const std::string image = firmware_file();
  std::filesystem::resize_file(image, 31);  // of 34 bytes, in the middle of its block
  Program emulator =
      Program::forcegrid({"emulate", "--device", "falcon", "--listen", "127.0.0.1:0", "--json"});
  const std::string line = emulator.wait_for_line("listening ");
  const std::string url = "usbip://" + line.substr(10, line.find(' ', 10) - 10) + "/1-1";
  Program run = Program::forcegrid({"run", "--device", url, "--profile", "falcon", "--firmware",
                                    image, "--scene", "small", "--seconds", "1", "--no-reference",
                                    "--out", fresh_folder("falcon_truncated")});
  EXPECT_EQ(run.wait(), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("firmware '" + image +
                                              "': byte 22: a block of 2 words begins, but only 3 "
                                              "bytes follow"));
  EXPECT_THAT(run.standard_error(), HasSubstr("nothing was sent"));
  emulator.send_signal(SIGTERM);
  ASSERT_EQ(emulator.wait(), 143) << emulator.standard_error();
  const std::string text = emulator.standard_output();
  const json report = parsed(text.substr(text.find('{')));
  EXPECT_EQ(report.at("firmware_state"), "cold");
  EXPECT_EQ(report.at("boot_handshakes"), 0);
  EXPECT_EQ(report.at("firmware_bytes_loaded"), 0);
}

TEST(FalconJob, PrintsTheKinematicsOfTheSheet) {
  Program program = Program::forcegrid({"kinematics", "--profile", "falcon", "--position",
                                        "0.02,-0.01,0.12", "--force", "1.5,-2,0.75"});
  ASSERT_EQ(program.wait(), 0) << program.standard_error();
  const json result = parsed(program.standard_output());
  EXPECT_EQ(result.at("command"), (json{-1666, 684, 127}));
  EXPECT_NEAR(result.at("joint_torque_Nm")[0].get<double>(), 0.166612722942, 1.5e-12);
  EXPECT_NEAR(result.at("position_m")[2].get<double>(), 0.12, 1e-12);
}

}  // namespace
}  // namespace forcegrid
