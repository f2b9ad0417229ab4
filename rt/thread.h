// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "rt/clock.h"

namespace forcegrid::rt {
#pragma GCC visibility push(default)

/// SCHED_FIFO priorities of the house, highest first: the bus must not wait for its host, and the
/// thread that carries reports must not wait for the thread that reads them.
inline constexpr int kEmulatorFramePriority = 90;
inline constexpr int kDeviceIoPriority = 82;
inline constexpr int kServoPriority = 80;

/// What the kernel granted a thread that asked for real-time scheduling.
struct Scheduling {
  bool realtime = false;  ///< SCHED_FIFO is in force, read back from the kernel
  int priority = 0;       ///< the priority in force, 0 without real-time scheduling
  std::string reason;     ///< why it was refused and what to do about it; empty when granted
};

/// Puts the calling thread under SCHED_FIFO at `priority` (1..99) and reads the result back.
/// Never throws for a refusal: the caller says so once and goes on.
/// Real-time: no (formats the reason); call it at the start of the thread.
Scheduling make_current_thread_realtime(int priority);

/// Locks this process's present and future memory and touches `stack_bytes` of the calling
/// thread's stack, so that no page fault falls into a cycle.
/// @returns empty when done, else the system's reason and the remedy.
/// Real-time: no; call it before the first cycle.
std::string lock_memory(std::size_t stack_bytes = 256 * 1024);

/// Undoes lock_memory() for work that may page, after the last cycle. Real-time: no.
void unlock_memory() noexcept;

/// Names the calling thread (at most 15 characters are kept), for `top -H` and debuggers.
void name_current_thread(const char* name) noexcept;

/// Sleeps until the absolute time `deadline` (CLOCK_MONOTONIC, TIMER_ABSTIME), resuming after
/// signals. Returns at once for a deadline in the past.
/// Real-time: yes; no allocation, lock or throw.
void sleep_until(TimePoint deadline) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::rt
