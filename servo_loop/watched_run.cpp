// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/watched_run.h"

#include <thread>

namespace forcegrid::servo {

ServoOutcome run_watched(ServoLoop& loop, const std::atomic<bool>& stop, double seconds,
                         const std::function<void()>& request_stop,
                         const std::function<void()>& watch) {
  ServoOutcome outcome;
  std::atomic<bool> ended{false};
  std::thread servo_thread([&] {
    outcome = loop.run(stop, seconds);
    ended = true;
  });
  try {
    while (!ended) {
      watch();
    }
  } catch (...) {
    request_stop();
    servo_thread.join();
    throw;
  }
  servo_thread.join();
  return outcome;
}

}  // namespace forcegrid::servo
