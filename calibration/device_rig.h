// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "calibration/rig.h"

namespace forcegrid::calibration {

/// An opened device in real time: steps begin at absolute deadlines.
///
/// Its motors have zero current once step() has thrown, and when it ends. The device's I/O thread
/// and its watchdog ensure that too if this process hangs.
/// Threads: one.
class DeviceRig final : public Rig {
 public:
  /// @param device, stop  outlive it; the calibration ends soon after `stop` has become true.
  /// @param report_timeout  the calibration ends if no new report comes for this long.
  DeviceRig(driver::Device& device, rt::Duration period, rt::Duration report_timeout,
            const std::atomic<bool>& stop);
  ~DeviceRig() override;

  driver::DeviceReport step(const driver::MotorCommand& command) override;
  [[nodiscard]] rt::Duration period() const noexcept override { return period_; }

 private:
  driver::Device& device_;
  rt::Duration period_;
  rt::Duration report_timeout_;
  const std::atomic<bool>& stop_;
  rt::TimePoint deadline_;
  driver::DeviceReport last_;
  rt::TimePoint last_news_;
};

}  // namespace forcegrid::calibration
