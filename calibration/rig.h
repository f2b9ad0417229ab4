// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>

#include "driver/device.h"
#include "rt/clock.h"

namespace forcegrid::calibration {

/// Why a calibration gave up, and what to do. The motors have zero current then.
class CalibrationError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The calibration was stopped (Ctrl-C). The motors have zero current then.
class Stopped : public CalibrationError {
 public:
  Stopped() : CalibrationError("stopped; nothing was written and the motors have no current") {}
};

/// A device as a calibration sees it: one time step after the other. Real devices and emulated arms
/// in simulated time both implement it.
class Rig {
 public:
  virtual ~Rig() = default;

  /// Commands the motors for one period and returns the counters after it.
  /// @throws CalibrationError if the device fails or is silent, Stopped if the calibration is
  ///   stopped.
  /// Real-time: no allocation or lock except when it throws. Threads: one.
  virtual driver::DeviceReport step(const driver::MotorCommand& command) = 0;

  /// How long a step lasts, nominally.
  [[nodiscard]] virtual rt::Duration period() const noexcept = 0;
};

}  // namespace forcegrid::calibration
