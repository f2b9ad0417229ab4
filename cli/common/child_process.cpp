// SPDX-License-Identifier: Apache-2.0
#include "cli/common/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <thread>

namespace forcegrid::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kEndTimeout{1000};

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

int remaining_ms(Clock::time_point deadline) {
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
  return static_cast<int>(std::max<std::chrono::milliseconds::rep>(left.count(), 0));
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& arguments) {
  int input[2];
  int output[2];
  if (pipe2(input, O_CLOEXEC) != 0) {
    fail("pipe");
  }
  if (pipe2(output, O_CLOEXEC) != 0) {
    close(input[0]);
    close(input[1]);
    fail("pipe");
  }
  std::vector<char*> argv;
  std::string program = "forcegrid";
  argv.push_back(program.data());
  std::vector<std::string> copies = arguments;
  copies.push_back("--no-config");  // the parent passes every setting
  for (std::string& argument : copies) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ == 0) {
    // Only calls that are safe between fork and exec.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) {
      _exit(127);
    }
    dup2(input[0], STDIN_FILENO);
    dup2(output[1], STDOUT_FILENO);
    execv("/proc/self/exe", argv.data());
    _exit(127);
  }
  close(input[0]);
  close(output[1]);
  if (pid_ < 0) {
    close(input[1]);
    close(output[0]);
    fail("could not start '" + arguments.front() + "'");
  }
  to_child_ = input[1];
  from_child_ = output[0];
}

ChildProcess::~ChildProcess() {
  // Read its output to the end; otherwise it would report a broken pipe.
  for (const int signal_number : {0, SIGTERM, SIGKILL}) {
    if (signal_number != 0 && !status_) {
      kill(pid_, signal_number);
    }
    if (!status_) {
      finish(kEndTimeout);
    }
  }
  close(from_child_);
}

std::optional<std::string> ChildProcess::read_line(std::chrono::milliseconds timeout) {
  const Clock::time_point deadline = Clock::now() + timeout;
  while (true) {
    const std::size_t newline = buffer_.find('\n');
    if (newline != std::string::npos) {
      std::string line = buffer_.substr(0, newline);
      buffer_.erase(0, newline + 1);
      return line;
    }
    pollfd ready{from_child_, POLLIN, 0};
    const int polled = poll(&ready, 1, remaining_ms(deadline));
    if (polled < 0 && errno == EINTR) {
      continue;
    }
    if (polled <= 0) {
      return std::nullopt;
    }
    char block[4096];
    const ssize_t count = read(from_child_, block, sizeof block);
    if (count <= 0) {
      return std::nullopt;
    }
    buffer_.append(block, static_cast<std::size_t>(count));
  }
}

std::string ChildProcess::finish(std::chrono::milliseconds timeout) {
  const Clock::time_point deadline = Clock::now() + timeout;
  if (to_child_ >= 0) {
    close(to_child_);
    to_child_ = -1;
  }
  std::string text;
  while (true) {
    const auto line = read_line(std::chrono::milliseconds(remaining_ms(deadline)));
    if (!line) {
      break;
    }
    text += *line + "\n";
  }
  while (!status_ && Clock::now() < deadline) {
    reap();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return text + buffer_;
}

bool ChildProcess::running() {
  reap();
  return !status_.has_value();
}

std::string ChildProcess::abnormal_end() {
  reap();
  if (!status_) {
    return {};
  }
  if (WIFSIGNALED(*status_)) {
    return std::string("was ended by signal ") + strsignal(WTERMSIG(*status_));
  }
  if (WEXITSTATUS(*status_) != 0) {
    return "ended with status " + std::to_string(WEXITSTATUS(*status_));
  }
  return {};
}

void ChildProcess::reap() noexcept {
  if (status_) {
    return;
  }
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) == pid_) {
    status_ = status;
  }
}

std::string listening_line(ChildProcess& child, const std::string& what) {
  const auto line = child.read_line(std::chrono::seconds(10));
  const std::string prefix = "listening ";
  if (!line || line->rfind(prefix, 0) != 0) {
    throw std::runtime_error("the " + what + " did not start" +
                             (child.running() ? " within 10 s" : " (its message is above)"));
  }
  return line->substr(prefix.size());
}

std::string listening_address(ChildProcess& child, const std::string& what) {
  const std::string line = listening_line(child, what);
  return line.substr(0, line.find(' '));
}

}  // namespace forcegrid::cli
