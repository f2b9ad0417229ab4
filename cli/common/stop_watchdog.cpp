// SPDX-License-Identifier: Apache-2.0
#include "cli/common/stop_watchdog.h"

#include <pthread.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <mutex>

#include "cli/common/stop_request.h"
#include "log/log.h"
#include "text/output_file.h"

namespace forcegrid::cli {
namespace {

// With what the operating system needs to take a large process apart, less than one second.
constexpr std::chrono::milliseconds kGrace{600};
// Of a process whose parent waits for it within its own grace.
constexpr std::chrono::milliseconds kGraceOfChild{300};
constexpr std::chrono::milliseconds kLookAtSignal{10};

std::atomic<int> own_ends{0};

std::mutex text_mutex;
std::string stopped_text;

void set_stopped_text(const std::string& what) {
  const std::lock_guard lock(text_mutex);
  stopped_text = what;
}

}  // namespace

StopWatchdog::StopWatchdog(bool silent) : silent_(silent) {
  // The signals are the other threads' to handle.
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this] { watch(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

StopWatchdog::~StopWatchdog() {
  over_ = true;
  StopRequest::wake();
  thread_.join();
}

void StopWatchdog::watch() noexcept {
  while (StopRequest::signal() == 0 && !over_) {
    StopRequest::wait_for_signal();
  }
  const std::chrono::milliseconds grace = silent_ ? kGraceOfChild : kGrace;
  auto deadline = std::chrono::steady_clock::now() + grace;
  while (!over_ && std::chrono::steady_clock::now() < deadline) {
    if (own_ends > 0) {
      // What comes after its end, the way out with its status, has the same time again.
      deadline = std::chrono::steady_clock::now() + grace;
    }
    std::this_thread::sleep_for(kLookAtSignal);
  }
  if (over_) {
    return;
  }
  text::remove_unfinished_files();
  if (!silent_) {
    const std::lock_guard lock(text_mutex);
    say_stopped(stopped_text);
  }
  _exit(status_after(StopRequest::signal()));
}

OwnEnd::OwnEnd() noexcept { ++own_ends; }
OwnEnd::~OwnEnd() { --own_ends; }

StoppedText::StoppedText(const std::string& what) { set_stopped_text(after_stopped(what)); }
StoppedText::~StoppedText() { set_stopped_text(""); }

std::string after_stopped(const std::string& what) {
  const std::string stopped = "stopped";
  return what.starts_with(stopped) ? what.substr(stopped.size()) : "; " + what;
}

void say_stopped(const std::string& more) {
  log::last_words("command", "stopped by " + StopRequest::signal_name() + more);
}

}  // namespace forcegrid::cli
