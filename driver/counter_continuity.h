#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "driver/mechanism.h"

namespace forcegrid::driver {

/// Why the counters of a device that has been away can't be believed; empty when they can.
///
/// A device of the W2 family does not say that it has lost its counters: they start from zero when
/// its power comes back, and follow the arm from there. Counters that went on while the arm was
/// moved look the same. So they are believed only where nothing seems to have happened: they belong
/// to a pose of the arm, within 10 mm of where the tool was.
/// @param last, now  counters a..f before and after.
/// Real-time: no. Threads: any; `mechanism` is used.
std::string why_counters_are_lost(Mechanism& mechanism, const std::array<std::int32_t, 6>& last,
                                  const std::array<std::int32_t, 6>& now);

}  // namespace forcegrid::driver
