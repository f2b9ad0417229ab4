#include "cli/terminal_keys.h"

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

// Set before the handlers are installed, and not changed while they are.
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

void on_fatal(int number) {
  restore();
  std::signal(number, SIG_DFL);
  raise(number);
}

void on_suspend(int /*number*/) {
  const bool was_changed = changed != 0;
  restore();
  raise(SIGSTOP);
  if (was_changed && in_foreground()) {
    change();
  }
}

constexpr std::array<int, 6> kFatal = {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGQUIT};

void handle(int number, void (*handler)(int), int flags) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = flags;
  sigemptyset(&action.sa_mask);
  sigaction(number, &action, nullptr);
}

void install_handlers() {
  for (const int number : kFatal) {
    handle(number, on_fatal, static_cast<int>(SA_RESETHAND));
  }
  handle(SIGTSTP, on_suspend, SA_RESTART);
  // Brought to the background, a terminal's process would be stopped for reading or setting it.
  handle(SIGTTIN, SIG_IGN, 0);
  handle(SIGTTOU, SIG_IGN, 0);
  static const bool at_exit = std::atexit(restore) == 0;
  static_cast<void>(at_exit);
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
  if (!handlers_) {
    return;
  }
  for (const int number : kFatal) {
    handle(number, SIG_DFL, 0);
  }
  for (const int number : {SIGTSTP, SIGTTIN, SIGTTOU}) {
    handle(number, SIG_DFL, 0);
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
  if (count <= 0) {  // hung up: there is no terminal any more, and poll() would not wait
    restore();
    active_ = false;
  }
  return false;
}

}  // namespace forcegrid::cli
