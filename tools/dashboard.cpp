// SPDX-License-Identifier: Apache-2.0
#include "tools/dashboard.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "rt/thread.h"

namespace forcegrid::tools {
namespace {

constexpr auto kFrame = std::chrono::milliseconds(200);
constexpr char kEnter[] = "\x1b[?1049h\x1b[?25l\x1b[2J";  // alternate screen, no cursor, clear
constexpr char kLeave[] = "\x1b[?25h\x1b[?1049l";
constexpr std::array<int, 6> kFatal = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGQUIT};

std::atomic<int> terminal{-1};  // while a dashboard has it
static_assert(std::atomic<int>::is_always_lock_free);

void put(const char* codes, std::size_t length) {
  const int file = terminal.load();
  if (file >= 0 && ::write(file, codes, length) < 0) {
    return;  // the terminal is gone; there is nothing left to restore
  }
}

// Only calls that are safe in a signal handler.
void restore_and_die(int number) {
  put(kLeave, sizeof kLeave - 1);
  ::signal(number, SIG_DFL);
  ::raise(number);
}

void restore_and_sleep(int) {
  put(kLeave, sizeof kLeave - 1);
  const int file = terminal.exchange(-1);  // so that no picture is drawn in between
  ::raise(SIGSTOP);
  terminal = file;
  put(kEnter, sizeof kEnter - 1);
}

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = restore_and_die;
  for (const int number : kFatal) {
    ::sigaction(number, &action, nullptr);
  }
  action.sa_handler = restore_and_sleep;
  action.sa_flags = SA_RESTART;
  ::sigaction(SIGTSTP, &action, nullptr);
}

void let_signals_be() {
  for (const int number : kFatal) {
    ::signal(number, SIG_DFL);
  }
  ::signal(SIGTSTP, SIG_DFL);
}

}  // namespace

void Dashboard::check(std::FILE* out) {
  const char* const term = std::getenv("TERM");
  if (::isatty(::fileno(out)) == 0) {
    throw std::runtime_error(
        "--live: the output is not a terminal; leave out --live (a line per second is printed "
        "instead), or over ssh request a terminal: ssh -t HOST forcegrid run --live");
  }
  if (term == nullptr || term[0] == '\0' || std::strcmp(term, "dumb") == 0) {
    throw std::runtime_error(
        "--live: this terminal (TERM) can't move its cursor; leave out --live, or set TERM, e.g. "
        "export TERM=xterm");
  }
}

Dashboard::Dashboard(std::FILE* out, DashboardTitle title) : out_(out), picture_(std::move(title)) {
  check(out);
  std::fflush(out_);
  terminal = ::fileno(out_);
  catch_signals();
  put(kEnter, sizeof kEnter - 1);
  thread_ = std::thread([this] {
    rt::name_current_thread("dashboard");
    while (!stop_) {
      draw();
      std::this_thread::sleep_for(kFrame);
    }
  });
}

Dashboard::~Dashboard() {
  stop_ = true;
  thread_.join();
  put(kLeave, sizeof kLeave - 1);
  let_signals_be();
  terminal = -1;
  std::fputs(notes_.c_str(), out_);
  std::fflush(out_);
}

void Dashboard::add(const servo::CycleRecord& cycle) {
  const std::lock_guard lock(mutex_);
  picture_.add(cycle);
}

void Dashboard::note(const std::string& text) {
  const std::lock_guard lock(mutex_);
  picture_.note(text);
  notes_ += text;
}

void Dashboard::draw() {
  winsize size{};
  const bool known = ::ioctl(::fileno(out_), TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  std::string frame = "\x1b[H";
  {
    const std::lock_guard lock(mutex_);
    const auto lines = picture_.lines(known ? size.ws_col : DashboardPicture::kColumns,
                                      known ? size.ws_row : DashboardPicture::kRows);
    for (std::size_t i = 0; i < lines.size(); ++i) {
      frame += (i == 0 ? "" : "\r\n") + lines[i] + "\x1b[K";
    }
  }
  frame += "\x1b[J";
  put(frame.data(), frame.size());
}

}  // namespace forcegrid::tools
