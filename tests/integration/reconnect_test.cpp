// SPDX-License-Identifier: Apache-2.0
// A device that vanishes in mid-force and comes back, as the person at the command line meets it.

#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using testing::Program;

// `forcegrid run` of an emulated device with a fault and the example's simulator, a light load.
std::vector<std::string> arguments(const std::string& simulator, const std::string& fault,
                                   const std::string& out, std::vector<std::string> more) {
  std::vector<std::string> all = {"run",        "--simulator", simulator,  "--fault",
                                  fault,        "--out",       out,        "--json",
                                  "--evaluate", "hold",        "--method", "hold",
                                  "--cells",    "8,8,8",       "--motion", "lissajous"};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

class Reconnect : public ::testing::Test {
 protected:
  Reconnect()
      : spring_({"python3", FORCEGRID_SOURCE_DIR "/examples/spring_simulator.py", "0", "100"}) {
    const std::string prefix = "listening on ";
    simulator_ = spring_.wait_for_line(prefix).substr(prefix.size());
  }

  json summary(Program& run) {
    const json result = json::parse(run.standard_output(), nullptr, false);
    EXPECT_FALSE(result.is_discarded()) << run.standard_output();
    return result.is_discarded() ? json::object() : result;
  }

  Program spring_;
  std::string simulator_;
};

TEST_F(Reconnect, EndsTheRunWithOneSentenceUnlessAskedFor) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(
      arguments(simulator_, "connection-closed", out, {"--calibrated", "--seconds", "20"}));
  ASSERT_EQ(run.wait(), 1) << run.standard_error();
  const json result = summary(run);
  EXPECT_EQ(result.at("faults").at(0).at("name"), "unplugged");
  EXPECT_EQ(result.at("reconnects"), 0);
  EXPECT_NE(run.standard_error().find("FAULT: The device is gone; check the cable"),
            std::string::npos)
      << run.standard_error();
  // The cable is gone, so the device's own watchdog has ended the current.
  EXPECT_EQ(result.at("emulator").at("watchdog_trips"), 1);
  EXPECT_LE(result.at("emulator").at("faults").at(0).at("seconds_until_motors_off").get<double>(),
            0.6);
}

TEST_F(Reconnect, GoesOnWithTheSameDeviceAndItsCounters) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(arguments(simulator_, "connection-closed:ms=20", out,
                                             {"--calibrated", "--seconds", "9", "--reconnect"}));
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json result = summary(run);
  EXPECT_EQ(result.at("faults"), json::array());
  EXPECT_EQ(result.at("reconnects"), 1);
  EXPECT_EQ(result.at("recovered_faults").at(0).at("name"), "unplugged");
  EXPECT_EQ(result.at("recalibrations"), 0);
  EXPECT_TRUE(std::filesystem::exists(out + "/flight_record_1.csv"));
  // It pushed again, and ended with zero current.
  EXPECT_LT(result.at("emulator").at("seconds_since_motors_nonzero").get<double>(), 2.0);
  EXPECT_TRUE(result.at("zero_current_delivered").get<bool>());
}

TEST_F(Reconnect, CalibratesADeviceThatHasLostItsPower) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(
      arguments(simulator_, "firmware-reboot:ms=500", out, {"--seconds", "9", "--reconnect"}));
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json result = summary(run);
  EXPECT_EQ(result.at("reconnects"), 1);
  EXPECT_EQ(result.at("recalibrations"), 1);
  EXPECT_EQ(result.at("emulator").at("counters_loaded"), 2);
  EXPECT_LT(result.at("emulator").at("seconds_since_motors_nonzero").get<double>(), 2.0);
}

TEST_F(Reconnect, RefusesLostCountersThatNobodyCanCalibrate) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(arguments(simulator_, "firmware-reboot:ms=500", out,
                                             {"--calibrated", "--seconds", "20", "--reconnect"}));
  ASSERT_EQ(run.wait(), 1) << run.standard_error();
  EXPECT_NE(run.standard_error().find("the device was not reconnected: its encoder counters"),
            std::string::npos)
      << run.standard_error();
  EXPECT_EQ(summary(run).at("faults").at(0).at("name"), "unplugged");
}

// Its firmware lives on while the cable is out, and is loaded again when its power was.
TEST_F(Reconnect, MeetsAFalconAgainWithAndWithoutItsFirmware) {
  for (const bool power_lost : {false, true}) {
    const std::string out = fresh_folder("run");
    Program run = Program::forcegrid(
        arguments(simulator_, power_lost ? "firmware-reboot:ms=500" : "connection-closed:ms=20",
                  out, {"--device", "emulated:falcon", "--seconds", "7", "--reconnect"}));
    ASSERT_EQ(run.wait(), 0) << run.standard_error();
    const json result = summary(run);
    EXPECT_EQ(result.at("faults"), json::array());
    EXPECT_EQ(result.at("reconnects"), 1);
    EXPECT_EQ(result.at("recovered_faults").at(0).at("name"), "unplugged");
    EXPECT_EQ(result.at("emulator").at("firmware_starts"), power_lost ? 2 : 1);
    EXPECT_LT(result.at("emulator").at("seconds_since_motors_nonzero").get<double>(), 2.0);
    EXPECT_EQ(result.at("emulator").at("final_command"), json({0, 0, 0}));
    EXPECT_TRUE(result.at("zero_current_delivered").get<bool>());
  }
}

TEST_F(Reconnect, GivesUpAfterItsTimeAndAtCtrlC) {
  for (const bool by_signal : {false, true}) {
    const std::string out = fresh_folder("run");
    Program run = Program::forcegrid(arguments(simulator_, "connection-closed:ms=60000", out,
                                               {"--calibrated", "--seconds", "60", "--reconnect",
                                                "--reconnect-timeout", by_signal ? "60" : "1"}));
    ASSERT_TRUE(run.wait_for_text("Waiting for the device")) << run.standard_error();
    if (by_signal) {
      run.send_signal(SIGINT);
    }
    ASSERT_EQ(run.wait(std::chrono::seconds(15)), 1) << run.standard_error();
    EXPECT_NE(run.standard_error().find(by_signal ? "stopped while waiting for the device"
                                                  : "the device did not come back within 1.0 s"),
              std::string::npos)
        << run.standard_error();
  }
}

TEST_F(Reconnect, SaysThatTheWatchdogStopsTheMotorsWhereNothingElseCan) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(
      arguments(simulator_, "nak-out", out, {"--calibrated", "--seconds", "20"}));
  ASSERT_EQ(run.wait(), 1) << run.standard_error();
  EXPECT_NE(run.standard_error().find("the motors are left to its own watchdog"), std::string::npos)
      << run.standard_error();
  const json result = summary(run);
  EXPECT_EQ(result.at("faults").at(0).at("name"), "stale_reports");
  EXPECT_FALSE(result.at("zero_current_delivered").get<bool>());
  EXPECT_EQ(result.at("emulator").at("watchdog_trips"), 1);
  EXPECT_EQ(result.at("emulator").at("final_current_mA"), json({0.0, 0.0, 0.0}));
}

TEST(FaultOption, IsRefusedWithTheNamesThereAre) {
  for (const char* command : {"emulate", "run"}) {
    Program wrong = Program::forcegrid(
        {command, "--device", "emulated:woodenhaptics_v2015", "--fault", "gremlins"});
    ASSERT_EQ(wrong.wait(), 2) << wrong.standard_error();
    EXPECT_NE(wrong.standard_error().find("fault 'gremlins' is unknown"), std::string::npos);
    EXPECT_NE(wrong.standard_error().find("frozen-encoder"), std::string::npos);
  }
}

TEST(FaultOption, IsListedWithItsKeysInTheHelp) {
  Program help = Program::forcegrid({"emulate", "--help"});
  ASSERT_EQ(help.wait(), 0);
  for (const char* name : {"drop-report",       "duplicate-report",
                           "late-report",       "short-report",
                           "long-report",       "corrupt-report",
                           "frozen-encoder",    "jumping-encoder",
                           "wrapping-encoder",  "saturated-encoder",
                           "stall-in",          "stall-out",
                           "stall-control",     "nak-out",
                           "over-long-payload", "babble",
                           "slow-firmware",     "watchdog-trip",
                           "firmware-reboot",   "connection-closed",
                           "wrong-way-motor",   "malformed-descriptors"}) {
    EXPECT_NE(help.standard_output().find(std::string("  ") + name), std::string::npos) << name;
  }
}

TEST(FaultOption, IsRefusedForADeviceThatIsNotEmulated) {
  Program run =
      Program::forcegrid({"run", "--device", "usbip://127.0.0.1:9/1-1", "--fault", "babble"});
  ASSERT_EQ(run.wait(), 1);
  EXPECT_NE(run.standard_error().find("only an emulated device can have injected faults"),
            std::string::npos)
      << run.standard_error();
}

}  // namespace
}  // namespace forcegrid
