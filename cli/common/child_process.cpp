// SPDX-License-Identifier: Apache-2.0
#include "cli/common/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "cli/common/child_message.h"
#include "cli/common/log_options.h"
#include "cli/common/stop_request.h"
#include "log/log.h"

namespace forcegrid::cli {
namespace {

using Clock = std::chrono::steady_clock;

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kEndTimeout{1000};
constexpr milliseconds kMotorsEndTimeout{5000};
constexpr milliseconds kLook{50};
// Longer than any step of loading a scene between two checkpoints.
constexpr seconds kSilence{10};
constexpr seconds kLoadingSaidAfter{1};
constexpr seconds kLoadingSaidEvery{5};
constexpr std::string_view kLoading = "loading ";
constexpr std::string_view kOwnMessage = "forcegrid: ";

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

int remaining_ms(Clock::time_point deadline) {
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
  return static_cast<int>(std::max<std::chrono::milliseconds::rep>(left.count(), 0));
}

struct Pipe {
  std::array<int, 2> end{-1, -1};  ///< to read, to write

  Pipe() {
    if (pipe2(end.data(), O_CLOEXEC) != 0) {
      fail("pipe");
    }
  }
  ~Pipe() {
    for (const int descriptor : end) {
      if (descriptor >= 0) {
        close(descriptor);
      }
    }
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  int take(std::size_t which) { return std::exchange(end[which], -1); }
};

// "ended with status 3"; empty for status 0.
std::string end_text(int status) {
  if (WIFSIGNALED(status)) {
    return std::string("was ended by signal ") + strsignal(WTERMSIG(status));
  }
  return WEXITSTATUS(status) != 0 ? "ended with status " + std::to_string(WEXITSTATUS(status)) : "";
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, ChildOptions options)
    : options_(std::move(options)), starting_(options_.announces_start) {
  Pipe input;
  Pipe output;
  Pipe errors;
  std::vector<char*> argv;
  const bool is_own = options_.program.empty();
  std::string program = is_own ? "forcegrid" : options_.program;
  const std::string path = is_own ? "/proc/self/exe" : options_.program;
  argv.push_back(program.data());
  std::vector<std::string> copies = arguments;
  if (is_own) {
    copies.push_back("--no-config");  // the parent passes every setting
  }
  for (std::string& argument : copies) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  std::vector<std::string> variables = environment_of_child();
  std::vector<char*> environment;
  for (std::string& variable : variables) {
    environment.push_back(variable.data());
  }
  environment.push_back(nullptr);
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ == 0) {
    // Only calls that are safe between fork and exec.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) {
      _exit(127);
    }
    dup2(input.end[0], STDIN_FILENO);
    dup2(output.end[1], STDOUT_FILENO);
    dup2(errors.end[1], STDERR_FILENO);
    execve(path.c_str(), argv.data(), environment.data());
    _exit(127);
  }
  if (pid_ < 0) {
    fail("could not start '" + arguments.front() + "'");
  }
  to_child_ = input.take(1);
  from_child_ = output.take(0);
  errors_ = errors.take(0);
  error_thread_ = std::thread([this] { pass_on_errors(); });
  std::string command = "process " + std::to_string(pid_) + ", " + options_.name + ":";
  for (const std::string& argument : copies) {
    command += " " + argument;
  }
  log::debug("start", command);
}

ChildProcess::~ChildProcess() {
  // Read its output to the end; otherwise it would report a broken pipe.
  if (StopRequest::signal() == 0) {
    finish(kEndTimeout);
  }
  terminate();
  finish(options_.drives_motors ? kMotorsEndTimeout : kEndTimeout);
  if (!status_) {
    kill(pid_, SIGKILL);
    finish(kEndTimeout);
  }
  over_ = true;
  error_thread_.join();
  close(errors_);
  close(from_child_);
}

void ChildProcess::terminate() noexcept {
  reap();
  if (!status_) {
    kill(pid_, SIGTERM);
  }
}

// On a thread of its own, so that the child never waits for a parent that is busy.
void ChildProcess::pass_on_errors() {
  std::string rest;
  std::array<char, 4096> block{};
  for (;;) {
    pollfd ready{errors_, POLLIN, 0};
    const int polled = poll(&ready, 1, static_cast<int>(kLook.count()));
    if (polled == 0 && over_) {
      break;  // a child of the child still holds the other end
    }
    if (polled <= 0) {
      continue;
    }
    const ssize_t count = read(errors_, block.data(), block.size());
    if (count < 0 && errno == EINTR) {
      continue;
    }
    if (count <= 0) {
      break;
    }
    rest.append(block.data(), static_cast<std::size_t>(count));
    for (std::size_t end = rest.find('\n'); end != std::string::npos; end = rest.find('\n')) {
      take_error_line(rest.substr(0, end));
      rest.erase(0, end + 1);
    }
  }
  if (!rest.empty()) {
    take_error_line(rest);
  }
}

// Of this process's own words, as that it loads.
void ChildProcess::say(log::Level level, const std::string& text) const {
  log::write({level, "start", text, options_.name});
}

void ChildProcess::take_error_line(const std::string& line) {
  auto message = read_child_message(line);
  const bool raw = !message;  // words of the system, a sanitizer, or about the command line
  if (raw) {
    const bool own = line.starts_with(kOwnMessage);
    message = log::Message{log::Level::kError, log::kRawComponent,
                           own ? line.substr(kOwnMessage.size()) : line};
  }
  const bool from_itself = message->process.empty();
  if (from_itself && message->level == log::Level::kError) {
    const std::lock_guard lock(mutex_);
    if (starting_ && (!raw || line.starts_with(kOwnMessage) || !reason_.empty())) {
      reason_ += (reason_.empty() ? "" : "\n") + message->text;
      return;
    }
  }
  if (from_itself && options_.says_details && message->level == log::Level::kInfo) {
    message->level = log::Level::kDebug;
  }
  message->process = options_.name + (from_itself ? "" : "/" + message->process);
  log::write(*message);
}

std::string ChildProcess::wait_until_started() {
  const Clock::time_point begun = Clock::now();
  Clock::time_point heard = begun;
  Clock::time_point told = begun + kLoadingSaidAfter - kLoadingSaidEvery;
  for (;;) {
    const auto line = read_line(kLook);
    if (StopRequest::stop()) {
      throw std::runtime_error("stopped while the " + options_.name + " started");
    }
    const Clock::time_point now = Clock::now();
    if (line && !line->starts_with(kLoading)) {
      std::string said;
      {
        const std::lock_guard lock(mutex_);
        starting_ = false;
        said = std::exchange(reason_, {});
      }
      if (!said.empty()) {
        say(log::Level::kError, said);
      }
      return *line;
    }
    if (line) {
      heard = now;
      if (now - told >= kLoadingSaidEvery) {
        told = now;
        say(log::Level::kInfo, *line);
      }
    } else if (output_ended_ || now - heard > kSilence) {
      throw std::runtime_error("the " + options_.name + " did not start: " + why_not_started());
    }
  }
}

std::string ChildProcess::why_not_started() {
  if (!output_ended_) {
    return "it gave no sign of life for " + std::to_string(kSilence.count()) +
           " s; see with 'ps' whether it is stopped, and free some memory or processor time";
  }
  wait_for_end(Clock::now() + kEndTimeout);
  over_ = true;
  error_thread_.join();  // everything that it said is read
  error_thread_ = std::thread([] {});
  const std::lock_guard lock(mutex_);
  if (!reason_.empty()) {
    return reason_;
  }
  const std::string how = status_ ? end_text(*status_) : "closed its output";
  return "it " + (how.empty() ? "ended" : how) + "; what it said, if anything, is above";
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
      output_ended_ = true;
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
  wait_for_end(deadline);
  return text + std::exchange(buffer_, {});
}

void ChildProcess::wait_for_end(Clock::time_point deadline) noexcept {
  for (reap(); !status_ && Clock::now() < deadline; reap()) {
    std::this_thread::sleep_for(milliseconds(1));
  }
}

bool ChildProcess::running() {
  reap();
  return !status_.has_value();
}

std::string ChildProcess::abnormal_end() {
  reap();
  return status_ ? end_text(*status_) : "";
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

std::string listening_line(ChildProcess& child) {
  const std::string line = child.wait_until_started();
  log::debug("start", "process " + std::to_string(child.pid()) + ": " + line);
  const std::string prefix = "listening ";
  if (!line.starts_with(prefix)) {
    throw std::runtime_error("a child process began with '" + line + "' instead of its address");
  }
  return line.substr(prefix.size());
}

std::string listening_address(ChildProcess& child) {
  const std::string line = listening_line(child);
  return line.substr(0, line.find(' '));
}

}  // namespace forcegrid::cli
