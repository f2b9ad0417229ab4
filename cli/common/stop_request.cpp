// SPDX-License-Identifier: Apache-2.0
#include "cli/common/stop_request.h"

#include <semaphore.h>

#include <cerrno>
#include <csignal>

namespace forcegrid::cli {
namespace {

std::atomic<int> first_signal{0};
sem_t signal_came;
std::atomic<bool> stop_flag{false};
servo::EmergencyStop emergency_stop;
servo::DeadManSignal dead_man_signal;
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

// sem_post() is safe in a signal handler.
void on_signal(int number) {
  const int error = errno;
  int none = 0;
  first_signal.compare_exchange_strong(none, number);
  StopRequest::request();
  sem_post(&signal_came);
  errno = error;
}

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
  stop_flag.store(true);
}

void StopRequest::install() {
  sem_init(&signal_came, 0, 0);
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    sigaction(number, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
}

int StopRequest::signal() noexcept { return first_signal.load(); }

std::string StopRequest::signal_name() {
  switch (signal()) {
    case 0:
      return "";
    case SIGINT:
      return "SIGINT";
    case SIGTERM:
      return "SIGTERM";
    default:
      return "SIGHUP";
  }
}

void StopRequest::wait_for_signal() noexcept {
  while (sem_wait(&signal_came) != 0 && errno == EINTR) {
  }
}

void StopRequest::wake() noexcept { sem_post(&signal_came); }

const std::atomic<bool>& StopRequest::stop() noexcept { return stop_flag; }

void StopRequest::request() noexcept { stop_flag.store(true); }

void StopRequest::forget() noexcept {
  stop_flag.store(false);
  if (signal() != 0 || emergency_stop.pressed()) {  // perhaps just now
    stop_flag.store(true);
  }
}

}  // namespace forcegrid::cli
