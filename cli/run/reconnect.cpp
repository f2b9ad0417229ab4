// SPDX-License-Identifier: Apache-2.0
#include "cli/run/reconnect.h"

#include <cmath>
#include <optional>
#include <thread>
#include <utility>

#include "driver/calibration.h"
#include "driver/counter_continuity.h"
#include "driver/mechanism.h"

namespace forcegrid::cli {
namespace {

constexpr auto kRetry = std::chrono::milliseconds(50);
constexpr auto kLookForDevice = std::chrono::milliseconds(20);
constexpr auto kCalibrationTimeout = std::chrono::seconds(60);

// @returns false when cancelled.
bool pause(const Reconnect& how) {
  const rt::TimePoint until = rt::Clock::now() + kRetry;
  while (rt::Clock::now() < until) {
    if (how.cancelled()) {
      return false;
    }
    std::this_thread::sleep_for(kLookForDevice);
  }
  return true;
}

std::string seconds_text(rt::Duration duration) {
  const long tenths = std::lround(10.0 * rt::seconds(duration));
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " s";
}

// Ensures that the counters are valid. @returns why they can't be used; empty if they can.
std::string settle_counters(const Reconnect& how, driver::Device& device, bool& recalibrated) {
  if (!how.may_calibrate) {
    const auto mechanism = driver::make_mechanism(*how.profile);
    const std::string lost =
        driver::why_counters_are_lost(*mechanism, how.last_counts, device.newest_report().counts);
    return lost.empty() ? "" : lost + "; restart without --calibrated";
  }
  recalibrated =
      driver::calibrate(device, *how.profile, kCalibrationTimeout, how.say, how.cancelled);
  return recalibrated ? "" : "stopped before it was calibrated again";
}

// Nothing: the device is not back, for this `reason`.
std::optional<Reconnected> try_once(const Reconnect& how, std::string& reason) {
  Reconnected result;
  try {
    std::unique_ptr<driver::Device> device = how.open();
    const driver::DeviceIdentity& now = device->identity();
    if (now.product != how.before.product || now.serial != how.before.serial) {
      result.why_not = "another device is connected: " + now.product + ", serial " + now.serial +
                       ", instead of " + how.before.product + ", serial " + how.before.serial;
      return result;
    }
    result.why_not = settle_counters(how, *device, result.recalibrated);
    if (result.why_not.empty()) {
      result.device = std::move(device);
    }
    return result;
  } catch (const driver::DeviceError& error) {
    reason = error.what();
    return std::nullopt;
  }
}

}  // namespace

Reconnected reconnect(const Reconnect& how) {
  Reconnected result;
  const rt::TimePoint gone = rt::Clock::now();
  std::string last_reason = "it could not be tried";
  while (!how.cancelled()) {
    if (std::optional<Reconnected> tried = try_once(how, last_reason)) {
      return std::move(*tried);
    }
    if (rt::Clock::now() - gone >= how.timeout) {
      result.why_not =
          "the device did not come back within " + seconds_text(how.timeout) + ": " + last_reason;
      return result;
    }
    if (!pause(how)) {
      break;
    }
  }
  result.why_not = "stopped while waiting for the device";
  return result;
}

}  // namespace forcegrid::cli
