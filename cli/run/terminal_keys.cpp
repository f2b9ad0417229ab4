// SPDX-License-Identifier: Apache-2.0
#include "cli/run/terminal_keys.h"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdlib>
#include <thread>

namespace forcegrid::cli {
namespace {

constexpr int kInput = STDIN_FILENO;

// Set before the handlers are installed, and constant while they are.
termios original;
termios one_key_at_a_time;
volatile std::sig_atomic_t changed = 0;

bool in_foreground() { return tcgetpgrp(kInput) == getpgrp(); }

// tcsetattr() is safe in a signal handler.
void restore() {
  if (changed != 0) {
    changed = 0;
    tcsetattr(kInput, TCSANOW, &original);
  }
}

void change() {
  if (tcsetattr(kInput, TCSANOW, &one_key_at_a_time) == 0) {
    changed = 1;
  }
}

constexpr std::array<int, 6> kFatal = {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGQUIT};

// The previous handler, which may have its own settings to restore.
std::array<struct sigaction, kFatal.size()> fatal_before;
struct sigaction suspend_before;

void on_fatal(int number) {
  restore();
  for (std::size_t i = 0; i < kFatal.size(); ++i) {
    if (kFatal[i] == number) {
      sigaction(number, &fatal_before[i], nullptr);
    }
  }
  raise(number);  // it is blocked until this handler returns
}

void on_suspend(int number) {
  const bool was_changed = changed != 0;
  restore();
  if (suspend_before.sa_handler != SIG_DFL && suspend_before.sa_handler != SIG_IGN) {
    suspend_before.sa_handler(number);
  } else {
    raise(SIGSTOP);
  }
  if (was_changed && in_foreground()) {
    change();
  }
}

struct sigaction action_of(void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  return action;
}

void install_handlers() {
  const struct sigaction fatal = action_of(on_fatal);
  for (std::size_t i = 0; i < kFatal.size(); ++i) {
    sigaction(kFatal[i], &fatal, &fatal_before[i]);
  }
  const struct sigaction suspend = action_of(on_suspend);
  sigaction(SIGTSTP, &suspend, &suspend_before);
  // A background process would be stopped for reading the terminal or changing its settings.
  const struct sigaction ignore = action_of(SIG_IGN);
  sigaction(SIGTTIN, &ignore, nullptr);
  sigaction(SIGTTOU, &ignore, nullptr);
  static const bool at_exit = std::atexit(restore) == 0;
  static_cast<void>(at_exit);
}

void remove_handlers() {
  for (std::size_t i = 0; i < kFatal.size(); ++i) {
    sigaction(kFatal[i], &fatal_before[i], nullptr);
  }
  sigaction(SIGTSTP, &suspend_before, nullptr);
  const struct sigaction usual = action_of(SIG_DFL);
  sigaction(SIGTTIN, &usual, nullptr);
  sigaction(SIGTTOU, &usual, nullptr);
}

}  // namespace

TerminalKeys::TerminalKeys() {
  if (isatty(kInput) != 1 || !in_foreground() || tcgetattr(kInput, &original) != 0) {
    return;
  }
  one_key_at_a_time = original;
  one_key_at_a_time.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  one_key_at_a_time.c_cc[VMIN] = 0;
  one_key_at_a_time.c_cc[VTIME] = 0;
  install_handlers();
  handlers_ = true;
  change();
  active_ = changed != 0;
}

TerminalKeys::~TerminalKeys() {
  restore();
  if (handlers_) {
    remove_handlers();
  }
}

bool TerminalKeys::emergency_pressed(std::chrono::milliseconds timeout) {
  if (!active_ || !in_foreground()) {
    std::this_thread::sleep_for(timeout);
    return false;
  }
  pollfd input{kInput, POLLIN, 0};
  if (poll(&input, 1, static_cast<int>(timeout.count())) <= 0) {
    return false;
  }
  std::array<char, 64> keys{};
  const ssize_t count = read(kInput, keys.data(), keys.size());
  for (ssize_t i = 0; i < count; ++i) {
    const char key = keys[static_cast<std::size_t>(i)];
    if (key == ' ' || key == 'e' || key == 'E') {
      return true;
    }
  }
  if (count <= 0) {  // hung up: the terminal is gone, and poll() would return at once
    restore();
    active_ = false;
  }
  return false;
}

}  // namespace forcegrid::cli
