// SPDX-License-Identifier: Apache-2.0
#include "tests/support/in_terminal.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>

namespace forcegrid::testing {

namespace {

// A terminal's session is a scheduling group of its own. Beside two guests at work such a group was
// seen to get 3 % of a core for 15 s, with all its threads ready to run (Linux 6.18). What is more
// urgent is not; to make it so takes root.
void make_the_session_urgent() {
  const int group = open("/proc/self/autogroup", O_WRONLY | O_CLOEXEC);
  if (group >= 0) {
    static_cast<void>(!write(group, "-20", 3));
    close(group);
  }
}

}  // namespace

InTerminal::InTerminal(std::vector<std::string> command) {
  std::vector<char*> argv;
  for (std::string& argument : command) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  winsize size{};
  size.ws_col = 80;
  size.ws_row = 24;
  // When the leader of the terminal's session ends, the kernel drops what nobody has read yet. So
  // the leader is a process that stays, and the program is its sibling, a child of this process.
  int started[2];
  if (pipe(started) != 0) {
    return;
  }
  leader_ = forkpty(&terminal_, nullptr, nullptr, &size);
  if (leader_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    make_the_session_urgent();
    const long program = syscall(SYS_clone, CLONE_PARENT | SIGCHLD, nullptr, nullptr, nullptr, 0L);
    if (program == 0) {
      close(started[0]);
      close(started[1]);
      setenv("TERM", "xterm", 1);
      execvp(argv[0], argv.data());
      _exit(127);
    }
    const auto pid = static_cast<pid_t>(program);
    static_cast<void>(!write(started[1], &pid, sizeof pid));
    for (int stream = 0; stream < 3; ++stream) {
      close(stream);
    }
    for (;;) {
      pause();
    }
  }
  close(started[1]);
  if (read(started[0], &pid_, sizeof pid_) != sizeof pid_) {
    pid_ = -1;
  }
  close(started[0]);
}

InTerminal::~InTerminal() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  if (leader_ > 0) {
    kill(leader_, SIGKILL);
    waitpid(leader_, nullptr, 0);
  }
  close(terminal_);
}

bool InTerminal::wait_for(const std::string& text) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (seen_.find(text, from_) == std::string::npos) {
    pollfd entry{terminal_, POLLIN, 0};
    if (std::chrono::steady_clock::now() > deadline || poll(&entry, 1, 1000) < 0) {
      return false;
    }
    char buffer[4096];
    const ssize_t count = entry.revents != 0 ? read(terminal_, buffer, sizeof buffer) : 0;
    if (count < 0) {
      return seen_.find(text, from_) != std::string::npos;  // EIO: the other end is closed
    }
    seen_.append(buffer, static_cast<std::size_t>(count));
  }
  return true;
}

void InTerminal::send_signal(int number) const {
  if (pid_ > 0) {
    kill(pid_, number);
  }
}

bool InTerminal::wait_until_stopped() const {
  int status = 0;
  return waitpid(pid_, &status, WUNTRACED) == pid_ && WIFSTOPPED(status);
}

int InTerminal::wait() {
  wait_for("\x1b never \x1b");
  int status = 0;
  for (int tries = 0; pid_ > 0 && tries < 200; ++tries) {
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      pid_ = -1;
      return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    usleep(10000);
  }
  return -1;
}

bool InTerminal::gave_the_terminal_back() {
  wait_for("\x1b never \x1b");
  return seen_.rfind(kLeaveScreen) != std::string::npos &&
         seen_.rfind(kLeaveScreen) > seen_.rfind(kEnterScreen) &&
         seen_.rfind("\x1b[?25h") > seen_.rfind("\x1b[?25l");
}

std::string InTerminal::seen_afterwards() const {
  return seen_.substr(std::min(seen_.rfind(kLeaveScreen), seen_.size()));
}

}  // namespace forcegrid::testing
