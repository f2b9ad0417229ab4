// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>

#include "servo_loop/servo_loop.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// Runs the loop on a thread of its own, and `watch` on the calling thread, again and again, until
/// the loop has ended.
///
/// An exception of `watch` ends the loop, not the program: the loop's last step, zero current and
/// the device's answer to it, comes before the exception goes on to the caller.
/// @param request_stop  sets `stop`; called when `watch` has thrown.
/// @param watch  takes 20 ms or so, so that it does not use up a processor.
/// @throws what `watch` throws.
ServoOutcome run_watched(ServoLoop& loop, const std::atomic<bool>& stop, double seconds,
                         const std::function<void()>& request_stop,
                         const std::function<void()>& watch);

#pragma GCC visibility pop
}  // namespace forcegrid::servo
