#pragma once

#include <atomic>
#include <string>

#include "driver/device.h"
#include "rt/percentiles.h"

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

/// [us] From handing a zero command to the device's I/O thread to the report that it released.
/// The device must be open; its motors get no current.
rt::Percentiles measure_device_round_trip(driver::Device& device, double seconds,
                                          const std::atomic<bool>& stop);

/// [us] From sending a position to a simulator, 50 mm above where the scenes lie, to the arrival of
/// the force for it.
/// @throws link::LinkError for an address that can't be used.
rt::Percentiles measure_simulator_round_trip(const std::string& address, double seconds,
                                             const std::atomic<bool>& stop);

}  // namespace forcegrid::tools
