// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "driver/mechanism.h"

namespace forcegrid::driver {

/// Why the counters of a reconnected device cannot be trusted; empty if they can.
///
/// A device of the W2 family does not report that it has lost its counters: when its power comes
/// back they start from zero and follow the arm from there. Counters that went on while the arm was
/// moved look the same. So they are trusted only if they belong to a pose of the arm that puts the
/// tool within 10 mm of its last position.
/// @param last, now  counters a..f before and after.
/// Real-time: no. Threads: any; `mechanism` is used.
std::string why_counters_are_lost(Mechanism& mechanism, const std::array<std::int32_t, 6>& last,
                                  const std::array<std::int32_t, 6>& now);

}  // namespace forcegrid::driver
