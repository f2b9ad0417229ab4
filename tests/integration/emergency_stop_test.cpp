// SPDX-License-Identifier: Apache-2.0
// Emergency stop and dead-man's switch as a user has them: by signal, key and button.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/fault_bench.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using testing::fresh_folder;
using testing::Program;

constexpr int kEmergencyStatus = 3;

std::vector<std::string> short_run(const std::string& out,
                                   const std::vector<std::string>& more = {}) {
  std::vector<std::string> arguments = {
      "run", "--scene", "small", "--seconds", "0", "--no-reference", "--out", out, "--json"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

void expect_motors_off(const json& summary) {
  EXPECT_TRUE(summary.at("zero_current_delivered"));
  for (const double current_mA : summary.at("emulator").at("final_current_mA")) {
    EXPECT_EQ(current_mA, 0.0);
  }
  EXPECT_EQ(summary.at("emulator").at("watchdog_trips"), 0);
}

TEST(EmergencyStop, ByASignalEndsTheRunAtZeroCurrentWithAStatusOfItsOwn) {
  const std::string out = fresh_folder("emergency_signal");
  Program run = Program::forcegrid(short_run(out));
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  std::this_thread::sleep_for(milliseconds(800));
  run.send_signal(SIGUSR1);
  ASSERT_EQ(run.wait(std::chrono::seconds(10)), kEmergencyStatus) << run.standard_error();
  EXPECT_NE(run.standard_error().find("EMERGENCY STOP by the signal SIGUSR1"), std::string::npos)
      << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("emergency_stop"), "signal");
  EXPECT_EQ(summary.at("faults").at(0).at("name"), "emergency_stop");
  EXPECT_GT(summary.at("emulator").at("max_abs_current_mA")[1].get<double>(), 0.0);
  expect_motors_off(summary);
}

/// The command in a session of its own whose terminal is the test's.
class AtATerminal {
 public:
  explicit AtATerminal(std::vector<std::string> arguments) {
    terminal_ = posix_openpt(O_RDWR | O_NOCTTY);
    EXPECT_GE(terminal_, 0);
    EXPECT_EQ(grantpt(terminal_), 0);
    EXPECT_EQ(unlockpt(terminal_), 0);
    const std::string name = ptsname(terminal_);
    arguments = testing::forcegrid_command(arguments);
    std::vector<char*> words;
    for (std::string& argument : arguments) {
      words.push_back(argument.data());
    }
    words.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      setsid();
      const int line = open(name.c_str(), O_RDWR);
      ioctl(line, TIOCSCTTY, 0);
      for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
        dup2(line, stream);
      }
      execv(words[0], words.data());
      _exit(127);
    }
    fcntl(terminal_, F_SETFL, O_NONBLOCK);
  }
  ~AtATerminal() {
    if (!status_) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    close(terminal_);
  }
  AtATerminal(const AtATerminal&) = delete;
  AtATerminal& operator=(const AtATerminal&) = delete;

  bool wait_for_text(const std::string& text) {
    return until(std::chrono::seconds(20), [&] { return said_.find(text) != std::string::npos; });
  }
  std::optional<int> wait() {
    until(std::chrono::seconds(10), [&] {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) == pid_) {
        status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      }
      return status_.has_value();
    });
    return status_;
  }
  void type(char key) const { EXPECT_EQ(write(terminal_, &key, 1), 1); }
  void send_signal(int number) const { kill(pid_, number); }
  /// Whether whole lines are read and shown, as a shell wants it.
  bool is_as_before() const {
    termios settings{};
    EXPECT_EQ(tcgetattr(terminal_, &settings), 0);
    return (settings.c_lflag & ICANON) != 0 && (settings.c_lflag & ECHO) != 0;
  }
  const std::string& said() const { return said_; }

 private:
  template <typename Condition>
  bool until(std::chrono::milliseconds timeout, Condition&& condition) {
    const auto end = std::chrono::steady_clock::now() + timeout;
    while (std::chrono::steady_clock::now() < end) {
      std::array<char, 4096> text;
      for (ssize_t n = 0; (n = read(terminal_, text.data(), text.size())) > 0;) {
        said_.append(text.data(), static_cast<std::size_t>(n));
      }
      if (condition()) {
        return true;
      }
      std::this_thread::sleep_for(milliseconds(10));
    }
    return false;
  }

  int terminal_ = -1;
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::string said_;
};

TEST(EmergencyStop, ByAKeyEndsTheRunAndGivesTheTerminalBack) {
  const std::string out = fresh_folder("emergency_key");
  AtATerminal run({"run", "--scene", "small", "--seconds", "0", "--no-reference", "--out", out});
  ASSERT_TRUE(run.wait_for_text("space or e stops the motors at once")) << run.said();
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.said();
  EXPECT_FALSE(run.is_as_before());
  run.type('x');  // means nothing
  run.type('e');
  EXPECT_EQ(run.wait(), kEmergencyStatus) << run.said();
  EXPECT_NE(run.said().find("EMERGENCY STOP by a key"), std::string::npos) << run.said();
  EXPECT_NE(run.said().find("zero current at the end delivered"), std::string::npos);
  EXPECT_TRUE(run.is_as_before());
}

TEST(EmergencyStop, GivesTheTerminalBackHoweverTheRunEnds) {
  for (const int signal : {SIGINT, SIGABRT}) {
    const std::string out = fresh_folder("emergency_terminal");
    AtATerminal run({"run", "--scene", "small", "--seconds", "0", "--no-reference", "--out", out});
    ASSERT_TRUE(run.wait_for_text("space or e stops the motors at once")) << run.said();
    EXPECT_FALSE(run.is_as_before());
    run.send_signal(signal);
    EXPECT_EQ(run.wait(), 128 + signal) << run.said();
    EXPECT_TRUE(run.is_as_before()) << signal;
  }
}

class DevicesButton : public ::testing::TestWithParam<const char*> {};

TEST_P(DevicesButton, IsAnEmergencyStop) {
  testing::FaultBench bench("", emulator::MotionKind::kLissajous, GetParam());
  bool pressed = false;
  bench.meanwhile = [&](emulator::EmulatorServer& server, double seconds) {
    if (seconds > 1.0 && !pressed) {
      pressed = true;
      server.device().press_calibration_button();
    }
  };
  const testing::FaultyRun run = bench.run(10.0);
  EXPECT_TRUE(pressed);
  EXPECT_EQ(run.outcome.fault, servo::Fault::kEmergencyStop) << servo::name_of(run.outcome.fault);
  EXPECT_EQ(run.outcome.emergency, servo::EmergencySource::kDeviceButton);
  EXPECT_TRUE(run.outcome.zero_current_delivered);
  EXPECT_EQ(run.last().current_A, (servo::Triple{}));
  EXPECT_EQ(run.emulator.watchdog_trips, 0u);
  // The driver sends the zero with the next exchange, as after any fault; a Falcon that lost a
  // packet takes 40 ms for one.
  EXPECT_LE(run.motors_off_after_ms(), 60.0 + run.held_up_ms);
}

INSTANTIATE_TEST_SUITE_P(Devices, DevicesButton, ::testing::Values("woodenhaptics_v2015", "falcon"),
                         [](const auto& test) { return std::string(test.param); });

TEST(DeadMan, WithoutItsSignalNothingIsFeltAndWithItTheForceComes) {
  const std::string out = fresh_folder("dead_man");
  Program run = Program::forcegrid(short_run(out, {"--dead-man", "signal"}));
  ASSERT_TRUE(run.wait_for_text("in contact")) << run.standard_error();
  EXPECT_EQ(run.standard_error().find("ramps in"), std::string::npos) << run.standard_error();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (run.standard_error().find("ramps in") == std::string::npos &&
         std::chrono::steady_clock::now() < end) {
    run.send_signal(SIGUSR2);
    std::this_thread::sleep_for(milliseconds(50));
  }
  EXPECT_TRUE(run.wait_for_text("the dead-man's switch is not held")) << run.standard_error();
  run.send_signal(SIGINT);
  ASSERT_EQ(run.wait(std::chrono::seconds(10)), 130) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_GT(summary.at("rung_cycles").at("fresh sample").get<int>(), 0);
  EXPECT_GT(summary.at("rung_cycles").at("zero current").get<int>(), 0);
  expect_motors_off(summary);
}

TEST(DeadMan, RefusesAButtonThatLatches) {
  Program run = Program::forcegrid(
      {"run", "--dead-man", "button", "--out", fresh_folder("dead_man_refused")});
  EXPECT_EQ(run.wait(), 1);
  EXPECT_NE(run.standard_error().find("--dead-man button: the only button of woodenhaptics_v2015 "
                                      "latches"),
            std::string::npos)
      << run.standard_error();
}

}  // namespace
}  // namespace forcegrid
