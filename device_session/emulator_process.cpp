// SPDX-License-Identifier: Apache-2.0
#include "device_session/emulator_process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <vector>

#include "device_session/program_path.h"
#include "rt/thread.h"

namespace forcegrid::session {
namespace {

constexpr rt::Duration kStart = std::chrono::seconds(10);
constexpr rt::Duration kEnd = std::chrono::seconds(3);
constexpr rt::Duration kLookForEnd = std::chrono::milliseconds(2);

[[noreturn]] void fail(const std::string& what) {
  throw SessionError(SessionError::Reason::kAbsent, "the emulated device did not start: " + what);
}

std::vector<std::string> arguments_of(const std::string& program, const SessionOptions& options,
                                      const std::string& profile) {
  std::vector<std::string> result = {program,
                                     "emulate",
                                     "--device",
                                     profile,
                                     "--listen",
                                     "127.0.0.1:0",
                                     "--hand",
                                     options.emulator_hand,
                                     "--motion",
                                     options.emulator_motion,
                                     "--wrist",
                                     options.emulator_wrist,
                                     "--click-every",
                                     std::to_string(options.emulator_click_every_s),
                                     "--calibrated",
                                     "--firmware-loaded",
                                     "--until-stdin-closes",
                                     "--linger",
                                     std::to_string(EmulatorProcess::kLinger_s),
                                     "--quiet",
                                     "--no-config",
                                     "--json"};
  const char* asked = std::getenv("FORCEGRID_EMULATOR_SUMMARY");
  result.push_back(!options.emulator_summary.empty()    ? options.emulator_summary
                   : asked != nullptr && *asked != '\0' ? asked
                                                        : "/dev/null");
  if (options.gravity_compensation) {
    result.push_back("--unsupported-weight");
  }
  return result;
}

// Signals as a program expects them at its start, and a group that Ctrl-C does not reach.
void set_attributes(posix_spawnattr_t& attributes) {
  sigset_t none;
  sigset_t all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(
      &attributes,
      static_cast<short>(POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP));
}

}  // namespace

EmulatorProcess::EmulatorProcess(const SessionOptions& options, const std::string& profile) {
  try {
    start(options, profile);
    std::istringstream words(first_line());
    std::string listening;
    std::string address;
    words >> listening >> address;
    if (listening != "listening") {
      fail("it says '" + words.str() + "'; run `forcegrid emulate --device " + profile +
           "` to see why");
    }
    url_ = "usbip://" + address + "/1-1";
  } catch (...) {
    end();
    throw;
  }
}

EmulatorProcess::~EmulatorProcess() { end(); }

void EmulatorProcess::start(const SessionOptions& options, const std::string& profile) {
  const std::string program = forcegrid_program();
  std::vector<std::string> words = arguments_of(program, options, profile);
  std::vector<char*> argv;
  for (std::string& word : words) {
    argv.push_back(word.data());
  }
  argv.push_back(nullptr);
  std::array<int, 2> input{-1, -1};
  std::array<int, 2> output{-1, -1};
  if (pipe2(input.data(), O_CLOEXEC) != 0) {
    fail(std::strerror(errno));
  }
  to_child_ = input[1];
  if (pipe2(output.data(), O_CLOEXEC) != 0) {
    const int reason = errno;
    ::close(input[0]);
    fail(std::strerror(reason));
  }
  from_child_ = output[0];
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_adddup2(&actions, input[0], STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output[1], STDOUT_FILENO);
  set_attributes(attributes);
  const int error =
      posix_spawn(&pid_, program.c_str(), &actions, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  ::close(input[0]);
  ::close(output[1]);
  if (error != 0) {
    pid_ = -1;
    fail(program + ": " + std::strerror(error));
  }
}

std::string EmulatorProcess::first_line() {
  const rt::TimePoint give_up = rt::Clock::now() + kStart;
  std::string line;
  while (line.empty() || line.back() != '\n') {
    pollfd readable{from_child_, POLLIN, 0};
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(give_up - rt::Clock::now());
    if (left.count() <= 0) {
      fail("it is silent for 10 s");
    }
    char byte = 0;
    if (::poll(&readable, 1, static_cast<int>(left.count())) <= 0) {
      continue;
    }
    const ssize_t got = ::read(from_child_, &byte, 1);
    if (got == 0) {
      fail("it ended at once; run `forcegrid emulate` to see why");
    }
    if (got > 0) {
      line += byte;
    }
  }
  return line;
}

void EmulatorProcess::end() noexcept {
  if (pid_ > 0) {
    ::kill(pid_, SIGTERM);
    const rt::TimePoint give_up = rt::Clock::now() + kEnd;
    while (::waitpid(pid_, nullptr, WNOHANG) == 0) {
      if (rt::Clock::now() > give_up) {
        ::kill(pid_, SIGKILL);
        ::waitpid(pid_, nullptr, 0);
        break;
      }
      rt::sleep_until(rt::Clock::now() + kLookForEnd);
    }
    pid_ = -1;
  }
  for (int* descriptor : {&to_child_, &from_child_}) {
    if (*descriptor >= 0) {
      ::close(*descriptor);
      *descriptor = -1;
    }
  }
}

}  // namespace forcegrid::session
