// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>

#include "driver/device.h"
#include "rt/clock.h"

namespace forcegrid::calibration {

/// Why a calibration was given up, with what to do. The motors have zero current then.
class CalibrationError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// It was asked to end (Ctrl-C). The motors have zero current then.
class Stopped : public CalibrationError {
 public:
  Stopped() : CalibrationError("stopped; nothing was written and the motors have no current") {}
};

/// A device as a calibration sees it: one step of time after the other. Real ones and emulated arms
/// in simulated time do the same.
class Rig {
 public:
  virtual ~Rig() = default;

  /// Lets the motors do as commanded for a period, and says what the counters are after it.
  /// @throws CalibrationError when the device fails or is silent, Stopped when it is asked to end.
  /// Real-time: no allocation or lock but when it throws. Threads: one.
  virtual driver::DeviceReport step(const driver::MotorCommand& command) = 0;

  /// How long a step lasts, nominally.
  [[nodiscard]] virtual rt::Duration period() const noexcept = 0;
};

}  // namespace forcegrid::calibration
