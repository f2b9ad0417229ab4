// SPDX-License-Identifier: Apache-2.0
#include "calibration/device_rig.h"

#include "rt/thread.h"

namespace forcegrid::calibration {

DeviceRig::DeviceRig(driver::Device& device, rt::Duration period, rt::Duration report_timeout,
                     const std::atomic<bool>& stop)
    : device_(device),
      period_(period),
      report_timeout_(report_timeout),
      stop_(stop),
      deadline_(rt::Clock::now()),
      last_(device.newest_report()),
      last_news_(deadline_) {}

DeviceRig::~DeviceRig() { device_.command({}); }

driver::DeviceReport DeviceRig::step(const driver::MotorCommand& command) {
  deadline_ += period_;
  const rt::TimePoint begun = rt::Clock::now();
  if (begun > deadline_) {
    deadline_ = begun + period_;  // paused: steps are not made up for
  }
  driver::MotorCommand sent = command;
  sent.next_read = deadline_;
  device_.command(sent);
  rt::sleep_until(deadline_);

  if (stop_.load(std::memory_order_acquire)) {
    device_.command({});
    throw Stopped();
  }
  if (device_.health() != driver::DeviceHealth::kRunning) {
    device_.command({});
    throw CalibrationError(device_.health() == driver::DeviceHealth::kUnplugged
                               ? "The device is gone; check the cable, plug it in again, and start "
                                 "again. Its own watchdog takes the current off the motors; no "
                                 "profile was changed. (" +
                                     device_.failure() + ")"
                               : device_.failure());
  }
  const driver::DeviceReport report = device_.newest_report();
  const rt::TimePoint now = rt::Clock::now();
  if (report.sequence != last_.sequence) {
    last_news_ = now;
  } else if (now - last_news_ > report_timeout_) {
    device_.command({});
    throw CalibrationError("device '" + device_.identity().url + "': no new report for " +
                           std::to_string(report_timeout_ / std::chrono::milliseconds(1)) +
                           " ms; look at its cable and power, and at "
                           "forcegrid doctor; the motors have no current");
  }
  last_ = report;
  return report;
}

}  // namespace forcegrid::calibration
