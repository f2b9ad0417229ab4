// SPDX-License-Identifier: Apache-2.0
#include "tests/support/program.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

namespace forcegrid::testing {
namespace {

std::string temporary(const std::string& name) {
  static std::atomic<int> next{0};
  return ::testing::TempDir() + "forcegrid_" + std::to_string(getpid()) + "_" +
         std::to_string(next++) + "_" + name;
}

constexpr auto kPoll = std::chrono::milliseconds(10);

bool has_device(const std::string& command) {
  return command == "run" || command == "record" || command == "calibrate";
}

}  // namespace

std::string text_of(const std::string& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

Program::Program(const std::vector<std::string>& command)
    : out_file_(temporary("stdout")), err_file_(temporary("stderr")) {
  std::vector<std::string> copies = command;
  std::vector<char*> argv;
  for (std::string& argument : copies) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  pid_ = fork();
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    const int out = open(out_file_.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600);
    const int err = open(err_file_.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600);
    const int in = open("/dev/null", O_RDONLY);
    dup2(in, STDIN_FILENO);
    dup2(out, STDOUT_FILENO);
    dup2(err, STDERR_FILENO);
    execvp(argv[0], argv.data());
    _exit(127);
  }
}

Program::~Program() {
  if (!status_) {
    kill(pid_, SIGKILL);
    wait();
  }
  std::filesystem::remove(out_file_);
  std::filesystem::remove(err_file_);
}

std::vector<std::string> forcegrid_command(std::vector<std::string> arguments) {
  const auto has = [&](const char* word) {
    return std::find(arguments.begin(), arguments.end(), word) != arguments.end();
  };
  if (!arguments.empty() && has_device(arguments.front()) && !has("--device-timeout-ms")) {
    arguments.insert(arguments.end(), {"--device-timeout-ms", "400"});
  }
  if (!has("--config")) {
    arguments.insert(arguments.begin(), "--no-config");
  }
  arguments.insert(arguments.begin(), FORCEGRID_PROGRAM);
  return arguments;
}

Program Program::forcegrid(std::vector<std::string> arguments) {
  return Program(forcegrid_command(std::move(arguments)));
}

void Program::send_signal(int number) const { kill(pid_, number); }

std::optional<int> Program::wait(std::chrono::milliseconds timeout) {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (!status_) {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      status_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
      break;
    }
    if (std::chrono::steady_clock::now() > deadline) {
      return std::nullopt;
    }
    std::this_thread::sleep_for(kPoll);
  }
  return status_;
}

std::string Program::standard_output() const { return text_of(out_file_); }
std::string Program::standard_error() const { return text_of(err_file_); }

std::string Program::wait_for_line(const std::string& prefix,
                                   std::chrono::milliseconds timeout) const {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (std::chrono::steady_clock::now() < deadline) {
    std::istringstream text(standard_output());
    std::string line;
    while (std::getline(text, line)) {
      if (line.rfind(prefix, 0) == 0 && !text.eof()) {
        return line;
      }
    }
    std::this_thread::sleep_for(kPoll);
  }
  ADD_FAILURE() << "no line '" << prefix << "...' from the program; it said: " << standard_output()
                << standard_error();
  return {};
}

bool Program::wait_for_text(const std::string& text, std::chrono::milliseconds timeout) const {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (std::chrono::steady_clock::now() < deadline) {
    if ((standard_output() + standard_error()).find(text) != std::string::npos) {
      return true;
    }
    std::this_thread::sleep_for(kPoll);
  }
  return false;
}

std::string fresh_folder(const std::string& name) {
  const std::string path = temporary(name);
  std::filesystem::remove_all(path);
  std::filesystem::create_directories(path);
  return path;
}

}  // namespace forcegrid::testing
