// SPDX-License-Identifier: Apache-2.0
// The main job through real bytes: emulated USB device, driver, servo loop, link, simulator, each
// as its user starts it.

#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using testing::Program;

// "listening 127.0.0.1:41234 ..." -> "127.0.0.1:41234"
std::string address_in(const std::string& line) {
  const std::string rest = line.substr(std::string("listening ").size());
  return rest.substr(0, rest.find(' '));
}

void expect_motors_off(const json& emulator) {
  ASSERT_TRUE(emulator.is_object());
  for (const double current_mA : emulator.at("final_current_mA")) {
    EXPECT_EQ(current_mA, 0.0);
  }
}

// The numbers of a CSV file, a row each, without its header.
std::vector<std::vector<double>> rows_of(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  std::vector<std::vector<double>> rows;
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    std::vector<double> row;
    for (std::string cell; std::getline(cells, cell, ',');) {
      row.push_back(std::stod(cell));
    }
    rows.push_back(row);
  }
  EXPECT_FALSE(rows.empty()) << path;
  return rows.empty() ? std::vector<std::vector<double>>{std::vector<double>(16)} : rows;
}

json parsed(const std::string& text) {
  const json result = json::parse(text, nullptr, false);
  EXPECT_FALSE(result.is_discarded()) << text;
  return result.is_discarded() ? json::object() : result;
}

// The child process of `parent` that runs `forcegrid COMMAND`; 0: none does.
pid_t child_of(pid_t parent, const std::string& command) {
  const std::string task = "/proc/" + std::to_string(parent) + "/task";
  for (const auto& thread : std::filesystem::directory_iterator(task)) {
    std::ifstream children(thread.path() / "children");
    for (pid_t child = 0; children >> child;) {
      std::ifstream stream("/proc/" + std::to_string(child) + "/cmdline");
      std::string program;
      std::string word;
      if (std::getline(stream, program, '\0') && std::getline(stream, word, '\0') &&
          word == command) {
        return child;
      }
    }
  }
  return 0;
}

TEST(MainJob, FeelsTheSmallBlockAndSaysHowItWent) {
  const std::string out = fresh_folder("run");
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--seconds", "6", "--out", out, "--json"});
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json summary = parsed(run.standard_output());
  // A machine with other work takes cycles away: then they are counted, and the rate says so.
  const double cycles = summary.at("cycles").get<double>();
  EXPECT_GT(cycles + summary.at("missed_deadlines").get<double>(), 2900.0);
  EXPECT_NEAR(summary.at("servo_rate_Hz").get<double>(), cycles / 6.0, 0.03 * cycles / 6.0);
  for (const char* key : {"period_us", "compute_us", "report_age_us"}) {
    for (const char* part : {"p50", "p99", "p999", "max"}) {
      EXPECT_GT(summary.at(key).at(part).get<double>(), 0.0) << key << part;
    }
  }
  EXPECT_NEAR(summary.at("period_us").at("p50").get<double>(), 2000.0, 500.0);
  EXPECT_TRUE(summary.at("realtime_scheduling").is_boolean());
  EXPECT_EQ(summary.at("method"), "auto");
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(summary.at("samples_received").get<int>(), 100);
  EXPECT_EQ(summary.at("samples_rejected").get<int>(), 0);
  EXPECT_TRUE(summary.at("reports_lost").is_number_unsigned());
  EXPECT_LE(summary.at("worst_relative_residual").get<double>(), 1e-3);
  // The force was really felt; the methods in the shadow are worse than perfect and better than
  // nothing, and the one that was felt is nearer to the reference than the streamed force.
  EXPECT_GT(summary.at("force_rms_N").get<double>(), 0.2);
  for (const char* method : {"hold", "forcegrid"}) {
    const double error = summary.at("rms_error_percent").at(method).get<double>();
    EXPECT_GT(error, 0.1) << method;
    EXPECT_LT(error, 60.0) << method;
  }
  EXPECT_GT(summary.at("rms_error_percent").at("auto").get<double>(), 0.0);
  EXPECT_LT(summary.at("rms_error_percent").at("auto").get<double>(),
            0.5 * summary.at("rms_error_percent").at("hold").get<double>());
  for (const auto& [old_key, key] : {std::pair{"truth", "reference"},
                                     {"truth_details", "reference_details"},
                                     {"encoder_doubts", "suspected_stuck_encoders"},
                                     {"member_cycles", "candidate_cycles"},
                                     {"member_changes", "candidate_changes"},
                                     {"first_member_changes", "first_candidate_changes"}}) {
    EXPECT_EQ(summary.at(old_key), summary.at(key)) << old_key << " is read for one version more";
  }
  EXPECT_EQ(summary.at("reference"), "computed");
  EXPECT_EQ(summary.at("reference_details").at("unconverged"), 0);
  expect_motors_off(summary.at("emulator"));
  EXPECT_EQ(summary.at("emulator").at("watchdog_trips"), 0);
  EXPECT_TRUE(summary.at("zero_current_delivered").get<bool>());
  for (const char* file : {"/forces.csv", "/forces.svg", "/forces.png"}) {
    EXPECT_GT(std::filesystem::file_size(out + file), 1000u) << file;
  }
  // The text for people went to standard error, with a live line a second.
  EXPECT_NE(run.standard_error().find("in contact"), std::string::npos);
  EXPECT_NE(run.standard_error().find("cycles in"), std::string::npos);
}

TEST(MainJob, SucceedsWithoutPicturesWhereThereIsNoGnuplot) {
  const std::string out = fresh_folder("run");
  const std::string path = std::getenv("PATH");
  setenv("PATH", out.c_str(), 1);
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--seconds", "2", "--out", out, "--json"});
  setenv("PATH", path.c_str(), 1);
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const std::string sentence = "no pictures: there is no gnuplot to draw " + out + "/forces.svg";
  EXPECT_NE(run.standard_error().find("Note: " + sentence), std::string::npos)
      << run.standard_error();
  const json notes = parsed(run.standard_output()).at("notes");
  EXPECT_NE(notes.dump().find("install the package gnuplot-nox"), std::string::npos) << notes;
  EXPECT_TRUE(std::filesystem::exists(out + "/forces.csv"));
}

TEST(MainJob, EndsWithZeroCurrentAndASummaryAtCtrlC) {
  const std::string out = fresh_folder("run");
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--seconds", "0", "--no-reference", "--device",
                          "emulated:phantom_desktop", "--out", out, "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  run.send_signal(SIGINT);
  ASSERT_EQ(run.wait(std::chrono::seconds(10)), 130) << run.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_EQ(summary.at("ended_by"), "SIGINT");
  EXPECT_EQ(summary.at("exit_status"), 130);
  EXPECT_TRUE(summary.at("force_max_N").is_null()) << "no reference force was computed";
  // The hand came from above and touched the block's top, at z = 0 of the workspace.
  const std::vector<double> touch = rows_of(out + "/forces.csv").front();
  for (const std::size_t axis : {1U, 2U, 3U}) {
    EXPECT_NEAR(touch.at(axis), 0.0, 0.002);
  }
  EXPECT_EQ(summary.at("reference"), "skipped by --no-reference");
  expect_motors_off(summary.at("emulator"));
  EXPECT_EQ(summary.at("emulator").at("watchdog_trips"), 0);
  EXPECT_GT(summary.at("emulator").at("max_abs_current_mA")[1].get<double>(), 0.0);
}

TEST(MainJob, EndsInAFaultWithAFlightRecordWhenTheDeviceVanishes) {
  const std::string out = fresh_folder("run");
  Program emulator =
      Program::forcegrid({"emulate", "--device", "woodenhaptics_v2015", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(emulator.wait_for_line("listening "));
  Program run =
      Program::forcegrid({"run", "--device", "usbip://" + address + "/1-1", "--scene", "small",
                          "--seconds", "60", "--no-reference", "--out", out, "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  emulator.send_signal(SIGKILL);
  ASSERT_EQ(run.wait(std::chrono::seconds(10)), 1) << run.standard_error();
  const json summary = parsed(run.standard_output());
  ASSERT_EQ(summary.at("faults").size(), 1u);
  EXPECT_EQ(summary.at("faults")[0].at("name"), "unplugged");
  EXPECT_NE(run.standard_error().find("FAULT: The device is gone"), std::string::npos);
  EXPECT_GT(std::filesystem::file_size(out + "/flight_record.csv"), 10000u);
}

TEST(MainJob, LeavesTheMotorsToTheWatchdogWhenItIsKilled) {
  Program emulator = Program::forcegrid(
      {"emulate", "--device", "woodenhaptics_v2015", "--listen", "127.0.0.1:0", "--json"});
  const std::string address = address_in(emulator.wait_for_line("listening "));
  Program run =
      Program::forcegrid({"run", "--device", "usbip://" + address + "/1-1", "--scene", "small",
                          "--seconds", "60", "--no-reference", "--out", fresh_folder("run")});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  run.send_signal(SIGKILL);
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  emulator.send_signal(SIGINT);
  ASSERT_EQ(emulator.wait(std::chrono::seconds(10)), 130);
  const std::string text = emulator.standard_output();
  const json report = parsed(text.substr(text.find('{')));
  expect_motors_off(report);
  EXPECT_EQ(report.at("watchdog_trips"), 1);
}

TEST(MainJob, FadesTheForceWhenTheSimulatorDies) {
  Program simulator =
      Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  const std::string out = fresh_folder("run");
  Program run =
      Program::forcegrid({"run", "--simulator", address, "--seconds", "8", "--out", out, "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  simulator.send_signal(SIGKILL);
  ASSERT_EQ(run.wait(), 4) << run.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_EQ(summary.at("ended_by"), "lost_simulator");
  expect_motors_off(summary.at("emulator"));
  // The last cycles before the end were already without force.
  EXPECT_GT(summary.at("emulator").at("seconds_since_motors_nonzero").get<double>(), 0.5);
}

TEST(MainJob, HasNoForceAndEndsWithFourWhenNoSimulatorEverStarts) {
  Program run = Program::forcegrid({"run", "--simulator", "127.0.0.1:9", "--seconds", "3", "--out",
                                    fresh_folder("run"), "--json"});
  ASSERT_EQ(run.wait(), 4) << run.standard_error();
  EXPECT_NE(run.standard_error().find("no sample from 127.0.0.1:9 yet: nobody listens there"),
            std::string::npos)
      << run.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("ended_by"), "no_simulator");
  EXPECT_EQ(summary.at("samples_received"), 0);
  EXPECT_NE(summary.at("notes").dump().find("no sample came from 127.0.0.1:9"), std::string::npos);
  for (const double current_mA : summary.at("emulator").at("max_abs_current_mA")) {
    EXPECT_EQ(current_mA, 0.0);
  }
}

TEST(LostSimulator, EndsTheRunWithFourWhenItIsStopped) {
  Program simulator =
      Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid({"record", out + "/run.h5", "--simulator", address, "--seconds",
                                    "60", "--simulator-timeout", "3", "--out", out, "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  simulator.send_signal(SIGSTOP);
  ASSERT_EQ(run.wait(std::chrono::seconds(20)), 4) << run.standard_error();
  EXPECT_NE(run.standard_error().find("the simulator is stopped, gone or out of reach"),
            std::string::npos)
      << run.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("ended_by"), "lost_simulator");
  EXPECT_NE(summary.at("notes").dump().find("was silent once"), std::string::npos);
  expect_motors_off(summary.at("emulator"));
  Program plot = Program::forcegrid({"plot", out + "/run.h5", "--out", out});
  ASSERT_EQ(plot.wait(), 0) << plot.standard_error();
  EXPECT_NE(plot.standard_output().find("complete"), std::string::npos);
}

TEST(LostSimulator, EndsTheRunSoonWhenItWasTheRunsOwnProcess) {
  const std::string out = fresh_folder("run");
  Program run = Program::forcegrid(
      {"run", "--scene", "small", "--seconds", "60", "--no-reference", "--out", out, "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  const pid_t simulator = child_of(run.pid(), "simulate");
  ASSERT_GT(simulator, 0);
  ASSERT_EQ(kill(simulator, SIGKILL), 0);
  ASSERT_EQ(run.wait(std::chrono::seconds(8)), 4) << run.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_EQ(summary.at("ended_by"), "lost_simulator");
  EXPECT_NE(summary.at("notes").dump().find("was ended by signal Killed"), std::string::npos);
  expect_motors_off(summary.at("emulator"));
}

TEST(LostSimulator, IsWaitedForIfAskedAndItsReturnIsSaid) {
  Program simulator =
      Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  Program run =
      Program::forcegrid({"run", "--simulator", address, "--seconds", "8", "--simulator-timeout",
                          "1", "--wait-for-simulator", "--out", fresh_folder("run"), "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  simulator.send_signal(SIGSTOP);
  ASSERT_TRUE(run.wait_for_text("The run waits for it")) << run.standard_error();
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  simulator.send_signal(SIGCONT);
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  EXPECT_NE(run.standard_error().find("samples come from " + address + " again"), std::string::npos)
      << run.standard_error();
}

TEST(MainJob, SaysTheReasonOfAProcessThatDoesNotStart) {
  const std::string out = fresh_folder("run");
  std::ofstream(out + "/bad.toml") << "description = \"bad\"\n[[object]]\nshape = \"block\"\n"
                                      "vertex_count = [1, 1, 1]\nlaw = \"linear\"\n"
                                      "size_m = [0.1, 0.1, 0.1]\nstiffness_N_per_m = 1.0\n";
  Program run = Program::forcegrid({"run", "--scene", out + "/bad.toml", "--out", out});
  ASSERT_EQ(run.wait(std::chrono::seconds(8)), 1) << run.standard_error();
  EXPECT_NE(
      run.standard_error().find("forcegrid: the simulator did not start: " + out + "/bad.toml"),
      std::string::npos)
      << run.standard_error();
  EXPECT_EQ(run.standard_error().find("within 10 s"), std::string::npos);
}

TEST(MainJob, FeelsAForeignSimulatorInPython) {
  Program spring({"python3", FORCEGRID_SOURCE_DIR "/examples/spring_simulator.py", "0", "100"});
  const std::string prefix = "listening on ";
  const std::string address = spring.wait_for_line(prefix).substr(prefix.size());
  Program run = Program::forcegrid(
      {"run", "--simulator", address, "--seconds", "6", "--out", fresh_folder("run"), "--json"});
  ASSERT_EQ(run.wait(), 0) << run.standard_error() << spring.standard_error();
  const json summary = parsed(run.standard_output());
  EXPECT_GT(summary.at("samples_received").get<int>(), 100);
  EXPECT_EQ(summary.at("samples_rejected"), 0);
  EXPECT_EQ(summary.at("faults"), json::array());
  // 100 N/m over some 10 mm: felt, and within the arm's 5 N.
  EXPECT_EQ(summary.at("cycles_limited"), 0);
  EXPECT_GT(summary.at("emulator").at("max_abs_current_mA")[2].get<double>(), 100.0);
  EXPECT_NE(
      summary.at("reference").get<std::string>().find("only the scenes of 'forcegrid simulate'"),
      std::string::npos);
}

TEST(MainJob, IsAFaultWhenTheDeviceHangsAndTheWatchdogProvesIt) {
  Program emulator = Program::forcegrid(
      {"emulate", "--device", "woodenhaptics_v2015", "--listen", "127.0.0.1:0", "--json"});
  const std::string address = address_in(emulator.wait_for_line("listening "));
  Program run = Program::forcegrid({"run", "--device", "usbip://" + address + "/1-1", "--scene",
                                    "small", "--seconds", "60", "--no-reference", "--out",
                                    fresh_folder("run"), "--json"});
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  emulator.send_signal(SIGSTOP);
  ASSERT_EQ(run.wait(std::chrono::seconds(15)), 1) << run.standard_error();
  emulator.send_signal(SIGCONT);
  const json summary = parsed(run.standard_output());
  ASSERT_EQ(summary.at("faults").size(), 1u);
  EXPECT_FALSE(summary.at("zero_current_delivered").get<bool>());
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  emulator.send_signal(SIGINT);
  ASSERT_EQ(emulator.wait(std::chrono::seconds(10)), 130);
  const std::string text = emulator.standard_output();
  expect_motors_off(parsed(text.substr(text.find('{'))));
}

TEST(MainJob, CompensatesTheLinksWeightWhereTheHandDoesNot) {
  const std::string out = fresh_folder("run");
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--seconds", "5", "--no-reference",
                          "--gravity-compensation", "--motion", "still", "--out", out, "--json"});
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json summary = parsed(run.standard_output());
  // The hand rests where it touched within what friction allows; a weight carried twice or not at
  // all moves it by more than 2 mm.
  EXPECT_NEAR(rows_of(out + "/forces.csv").back().at(3), -0.0004, 0.0008);
  EXPECT_GT(summary.at("emulator").at("max_abs_current_mA")[2].get<double>(), 50.0);
}

TEST(MainJob, RefusesADeviceThatSomebodyElseHolds) {
  Program emulator =
      Program::forcegrid({"emulate", "--device", "woodenhaptics_v2015", "--listen", "127.0.0.1:0"});
  const std::string url = "usbip://" + address_in(emulator.wait_for_line("listening ")) + "/1-1";
  Program first = Program::forcegrid({"run", "--device", url, "--simulator", "127.0.0.1:9",
                                      "--seconds", "30", "--out", fresh_folder("run")});
  ASSERT_TRUE(first.wait_for_text("Device: ")) << first.standard_error();
  Program second = Program::forcegrid({"run", "--device", url, "--simulator", "127.0.0.1:9",
                                       "--seconds", "3", "--out", fresh_folder("run")});
  EXPECT_EQ(second.wait(std::chrono::seconds(15)), 1);
  EXPECT_NE(second.standard_error().find(url), std::string::npos) << second.standard_error();
  first.send_signal(SIGINT);
  EXPECT_TRUE(first.wait(std::chrono::seconds(10)).has_value());
}

}  // namespace
}  // namespace forcegrid
