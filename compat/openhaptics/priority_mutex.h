// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pthread.h>
#include <time.h>

#include <chrono>

#include "rt/clock.h"

namespace forcegrid::openhaptics {

/// A mutex with priority inheritance: a program's thread that holds it runs at the servo thread's
/// priority while that one waits. Threads: any.
class PriorityMutex {
 public:
  PriorityMutex() noexcept {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
  ~PriorityMutex() { pthread_mutex_destroy(&mutex_); }
  PriorityMutex(const PriorityMutex&) = delete;
  PriorityMutex& operator=(const PriorityMutex&) = delete;

  void lock() noexcept { pthread_mutex_lock(&mutex_); }
  void unlock() noexcept { pthread_mutex_unlock(&mutex_); }
  pthread_mutex_t* native() noexcept { return &mutex_; }

 private:
  pthread_mutex_t mutex_{};
};

/// Wakes threads that wait with a PriorityMutex held. Threads: any.
class Condition {
 public:
  Condition() noexcept {
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&condition_, &attributes);
    pthread_condattr_destroy(&attributes);
  }
  ~Condition() { pthread_cond_destroy(&condition_); }
  Condition(const Condition&) = delete;
  Condition& operator=(const Condition&) = delete;

  void wake_all() noexcept { pthread_cond_broadcast(&condition_); }
  /// Waits until `holds` or `deadline`. @returns whether it holds.
  template <typename Predicate>
  bool wait_until(PriorityMutex& mutex, rt::TimePoint deadline, const Predicate& holds) {
    const auto at = std::chrono::nanoseconds(deadline.time_since_epoch()).count();
    const timespec until{at / 1'000'000'000, at % 1'000'000'000};
    while (!holds()) {
      if (pthread_cond_timedwait(&condition_, mutex.native(), &until) != 0) {
        return holds();
      }
    }
    return true;
  }
  template <typename Predicate>
  void wait(PriorityMutex& mutex, const Predicate& holds) {
    while (!holds()) {
      pthread_cond_wait(&condition_, mutex.native());
    }
  }

 private:
  pthread_cond_t condition_{};
};

}  // namespace forcegrid::openhaptics
