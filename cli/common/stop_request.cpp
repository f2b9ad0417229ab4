// SPDX-License-Identifier: Apache-2.0
#include "cli/common/stop_request.h"

#include <csignal>

namespace forcegrid::cli {
namespace {

std::atomic<int> requests{0};
std::atomic<bool> stop_flag{false};
std::atomic<bool> hurry_flag{false};
std::atomic<bool> main_part_over{false};
servo::EmergencyStop emergency_stop;
servo::DeadManSignal dead_man_signal;
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

void on_signal(int /*signal*/) { StopRequest::request(); }

void on_emergency(int /*signal*/) {
  StopRequest::request_emergency(servo::EmergencySource::kSignal);
}

// clock_gettime() is safe in a signal handler.
void on_sign(int /*signal*/) { dead_man_signal.sign(rt::Clock::now()); }

void handle(int number, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(number, &action, nullptr);
}

}  // namespace

void StopRequest::install_switches() {
  handle(SIGUSR1, on_emergency);
  handle(SIGUSR2, on_sign);
}

servo::EmergencyStop& StopRequest::emergency() noexcept { return emergency_stop; }

const servo::DeadManSignal& StopRequest::dead_man() noexcept { return dead_man_signal; }

void StopRequest::request_emergency(servo::EmergencySource source) noexcept {
  emergency_stop.press(source);
  hurry_flag.store(true);
  stop_flag.store(true);
}

void StopRequest::install() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    sigaction(number, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
}

const std::atomic<bool>& StopRequest::stop() noexcept { return stop_flag; }

const std::atomic<bool>& StopRequest::hurry() noexcept { return hurry_flag; }

void StopRequest::request() noexcept {
  if (requests.fetch_add(1) > 0 || main_part_over.load()) {
    hurry_flag.store(true);
  }
  stop_flag.store(true);
}

void StopRequest::main_part_is_over() noexcept { main_part_over.store(true); }

}  // namespace forcegrid::cli
