// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "driver/device.h"
#include "rt/percentiles.h"
#include "tools/doctor.h"

namespace forcegrid::tools {

/// Wake-up latency of a thread at the servo's priority that sleeps until absolute times, as
/// cyclictest measures it.
struct WakeupTest {
  rt::Percentiles latency_us;
  bool realtime = false;  ///< SCHED_FIFO was granted
};

/// @param load whether all processors copy memory and one thread writes to the disk meanwhile.
/// @param stop ends the measurement early.
/// Real-time: no. Starts threads and joins them.
WakeupTest measure_wakeups(double seconds, double period_s, bool load,
                           const std::atomic<bool>& stop);

/// Rates wake-up latencies for a loop with the period `period_us` [us].
Finding judge_wakeups(const std::string& check, const WakeupTest& test, double period_us);

/// Commands or positions sent, and the round trips until their answers.
struct RoundTrips {
  rt::Percentiles us;
  std::uint64_t sent = 0;
  std::uint64_t unanswered = 0;  ///< within 20 ms; a simulator may answer several at once
};

/// Measures the time from handing a zero command to the device's I/O thread to the report that it
/// released. The device must be open; its motors get no current.
RoundTrips measure_device_round_trip(driver::Device& device, double seconds,
                                     const std::atomic<bool>& stop);

/// Reports round trips. They have no deadline, so only missing answers affect the verdict.
/// @param remedy what to do if no answer comes.
Finding judge_round_trips(const std::string& check, const RoundTrips& trips,
                          const std::string& remedy);

/// Finding for a measurement that failed.
/// @param reason "what happened; the remedy", as in the project's set-up errors.
Finding not_measured(const std::string& check, const std::string& reason);

/// Measures the time from sending a position to a simulator to the arrival of its force. The
/// position is 50 mm above the scenes.
/// @throws link::LinkError if the address can't be used.
RoundTrips measure_simulator_round_trip(const std::string& address, double seconds,
                                        const std::atomic<bool>& stop);

}  // namespace forcegrid::tools
