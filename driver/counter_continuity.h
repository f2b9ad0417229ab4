#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "driver/mechanism.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::driver {

/// Why the counters of a device that has been away can't be believed; empty when they can.
///
/// A device of the W2 family does not say that it has lost its counters; they start from zero when
/// its power comes back. So they are believed unless they are about zero and were not before,
/// belong to no pose of the arm, or put the tool farther away than `away` allows at the profile's
/// largest speed.
/// @param last, now  counters a..f before and after.
/// Real-time: no. Threads: any; `mechanism` is used.
std::string why_counters_are_lost(Mechanism& mechanism, const profiles::DeviceProfile& profile,
                                  const std::array<std::int32_t, 6>& last,
                                  const std::array<std::int32_t, 6>& now, rt::Duration away);

}  // namespace forcegrid::driver
