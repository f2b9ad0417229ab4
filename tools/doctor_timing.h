#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "driver/device.h"
#include "rt/percentiles.h"
#include "tools/doctor.h"

namespace forcegrid::tools {

/// How late a thread at the servo's priority wakes up that sleeps until absolute times, as
/// cyclictest measures it.
struct WakeupTest {
  rt::Percentiles latency_us;
  bool realtime = false;  ///< SCHED_FIFO was granted
};

/// @param load whether all processors copy memory and one thread writes to the disk meanwhile.
/// @param stop ends it early.
/// Real-time: no; starts threads of its own and ends them.
WakeupTest measure_wakeups(double seconds, double period_s, bool load,
                           const std::atomic<bool>& stop);

/// What wake-up latencies mean for a loop with this period.
Finding judge_wakeups(const std::string& check, const WakeupTest& test, double period_us);

/// Commands and what came of them.
struct RoundTrips {
  rt::Percentiles us;
  std::uint64_t sent = 0;
  std::uint64_t unanswered = 0;  ///< within 20 ms; a simulator may answer several at once
};

/// From handing a zero command to the device's I/O thread to the report that it released.
/// The device must be open; its motors get no current.
RoundTrips measure_device_round_trip(driver::Device& device, double seconds,
                                     const std::atomic<bool>& stop);

/// Tells round trips, which have no deadline of their own; only answers that did not come are
/// judged.
/// @param remedy what to do without any answer.
Finding judge_round_trips(const std::string& check, const RoundTrips& trips,
                          const std::string& remedy);

/// A measurement that could not be made.
/// @param reason "what happened; the remedy", as our set-up errors say it.
Finding not_measured(const std::string& check, const std::string& reason);

/// From sending a position to a simulator, 50 mm above where the scenes lie, to the arrival of
/// the force for it.
/// @throws link::LinkError for an address that can't be used.
RoundTrips measure_simulator_round_trip(const std::string& address, double seconds,
                                        const std::atomic<bool>& stop);

}  // namespace forcegrid::tools
