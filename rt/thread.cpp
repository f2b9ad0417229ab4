// SPDX-License-Identifier: Apache-2.0
#include "rt/thread.h"

#include <alloca.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <time.h>

#include <cerrno>
#include <cstring>

namespace forcegrid::rt {

Scheduling make_current_thread_realtime(int priority) {
  sched_param parameter{};
  parameter.sched_priority = priority;
  // pthread_* functions return their error instead of setting errno.
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
  Scheduling result;
  if (error != 0) {
    result.reason = std::string("SCHED_FIFO refused (") + std::strerror(error) +
                    "); run as root, or grant it: 'setcap cap_sys_nice,cap_ipc_lock+ep' on the "
                    "program, or 'rtprio 95' and 'memlock unlimited' in /etc/security/limits.d";
    return result;
  }
  int policy = 0;
  sched_param granted{};
  const int read_error = pthread_getschedparam(pthread_self(), &policy, &granted);
  if (read_error != 0 || policy != SCHED_FIFO) {
    result.reason = "SCHED_FIFO was accepted but is not in force";
    return result;
  }
  result.realtime = true;
  result.priority = granted.sched_priority;
  return result;
}

std::string lock_memory(std::size_t stack_bytes) {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    return std::string("memory could not be locked (") + std::strerror(errno) +
           "); raise 'memlock' in /etc/security/limits.d or grant cap_ipc_lock";
  }
  volatile char* stack = static_cast<volatile char*>(alloca(stack_bytes));
  for (std::size_t i = 0; i < stack_bytes; i += 4096) {
    stack[i] = 0;
  }
  return {};
}

void unlock_memory() noexcept { munlockall(); }

void name_current_thread(const char* name) noexcept {
  char shortened[16] = {};
  std::strncpy(shortened, name, sizeof shortened - 1);
  pthread_setname_np(pthread_self(), shortened);
}

void sleep_until(TimePoint deadline) noexcept {
  const auto since_epoch = deadline.time_since_epoch();
  const auto whole = std::chrono::duration_cast<std::chrono::seconds>(since_epoch);
  timespec at{};
  at.tv_sec = whole.count();
  at.tv_nsec = std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch - whole).count();
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
}

}  // namespace forcegrid::rt
