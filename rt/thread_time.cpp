// SPDX-License-Identifier: Apache-2.0
#include "rt/thread_time.h"

#include <time.h>

namespace forcegrid::rt {

double thread_time_s() noexcept {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace forcegrid::rt
