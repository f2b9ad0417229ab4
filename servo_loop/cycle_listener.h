// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "driver/device.h"
#include "driver/kinematics.h"
#include "servo_loop/cycle_record.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// Told of each cycle of a ServoLoop when its command is out. Its time is part of the cycle's.
/// Real-time: an implementation neither allocates, locks, throws nor waits. Threads: the servo's.
class CycleListener {
 public:
  virtual ~CycleListener() = default;
  /// @param record as it goes to telemetry, but with compute_us 0. @param report the one that the
  /// cycle used, @param pose its pose.
  virtual void cycle_ended(const CycleRecord& record, const driver::DeviceReport& report,
                           const driver::ArmPose& pose) noexcept = 0;
};

#pragma GCC visibility pop
}  // namespace forcegrid::servo
