// SPDX-License-Identifier: Apache-2.0
#include "driver/device.h"

namespace forcegrid::driver {

const char* to_string(DeviceHealth health) noexcept {
  switch (health) {
    case DeviceHealth::kRunning:
      return "device running";
    case DeviceHealth::kStale:
      return "device silent";
    case DeviceHealth::kUnplugged:
      return "device unplugged";
    case DeviceHealth::kTaken:
      return "device taken by another program";
    case DeviceHealth::kSecondWriter:
      return "device commanded by another program, too";
    case DeviceHealth::kProtocol:
      return "device broke the protocol";
    case DeviceHealth::kClosed:
      return "device closed";
  }
  return "device in an unknown state";
}

void add(DeviceStatistics& sum, const DeviceStatistics& more) noexcept {
  sum.reports_received += more.reports_received;
  sum.reports_rejected += more.reports_rejected;
  sum.reports_drained += more.reports_drained;
  sum.reports_discarded += more.reports_discarded;
  sum.reports_lost += more.reports_lost;
  sum.reports_late += more.reports_late;
  sum.reports_unasked += more.reports_unasked;
  sum.commands_sent += more.commands_sent;
  sum.kicks += more.kicks;
  sum.commands_starved += more.commands_starved;
  sum.commands_not_finite += more.commands_not_finite;
  sum.commands_clamped += more.commands_clamped;
  sum.refreshes += more.refreshes;
}

}  // namespace forcegrid::driver
