// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "device_emulator/boot_loader_faults.h"
#include "device_emulator/device_options.h"
#include "device_emulator/emulator_report.h"
#include "device_emulator/usb.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// An emulated device as a USB bus sees it, with a report of what its motors did.
///
/// Everything happens at times given by the caller, which must not decrease: simulated in tests,
/// CLOCK_MONOTONIC in the server.
///
/// Real-time: advance_to(), run(), wake_time() and the state queries neither lock nor throw nor
/// allocate by themselves (what a UsbHost does is its own affair). Threads: one.
class EmulatedDevice {
 public:
  /// A longer gap between two calls (the process was stopped) is not integrated but counted.
  static constexpr rt::Duration kLongestStep = std::chrono::seconds(1);

  virtual ~EmulatedDevice() = default;

  [[nodiscard]] virtual UsbIdentity identity() const noexcept = 0;
  /// All endpoints beside endpoint 0; the same for the device's life.
  [[nodiscard]] virtual std::span<const UsbEndpoint> endpoints() const noexcept = 0;
  [[nodiscard]] virtual bool configured() const noexcept = 0;
  /// Whether an endpoint answers STALL.
  [[nodiscard]] virtual bool halted(std::uint8_t endpoint_address) const noexcept = 0;

  /// A control transfer on endpoint 0, answered at once. `data` is what the host sent in the data
  /// stage. May allocate.
  virtual ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                               rt::TimePoint now) = 0;

  /// Moves the packets that device and host have for each other at `now`; called in every bus
  /// frame, and for a device with a bulk endpoint also between frames: when the host has submitted
  /// something and at wake_time(). The host has nothing for, and asks nothing of, endpoints that
  /// are halted or of a device that is not configured.
  virtual void run(rt::TimePoint now, UsbHost& host) = 0;

  /// When a bulk endpoint that the host asks will have something for it; nothing when only the
  /// host can change that.
  [[nodiscard]] virtual std::optional<rt::TimePoint> wake_time() const noexcept {
    return std::nullopt;
  }

  /// Physics, operator and watchdog up to `now`.
  virtual void advance_to(rt::TimePoint now) noexcept = 0;

  /// The host lets go of the device; it goes on under its own power.
  virtual void bus_reset(rt::TimePoint now) noexcept = 0;

  /// Power is gone and back at once: the firmware starts anew and knows nothing of before; what the
  /// arm and the person do goes on. A device that keeps nothing in its firmware has only its bus
  /// reset.
  virtual void power_cycle(rt::TimePoint now) noexcept { bus_reset(now); }

  /// Whether a motor has current.
  [[nodiscard]] virtual bool motors_on() const;

  /// Whether the cable is plugged in. Otherwise the device is not listed and cannot be imported,
  /// and a client that has imported it is cut off.
  [[nodiscard]] virtual bool plugged_in() const noexcept { return true; }

  /// The person presses the button that the device has for calibration; nothing on one without.
  virtual void press_calibration_button() noexcept {}

  /// From now on `faults`, which outlives the device or is null, says what its boot loader does
  /// wrong; nothing on a device without one.
  virtual void set_boot_loader_faults(BootLoaderFaults* /*faults*/) noexcept {}

  /// Device part of the report (frames and attachment belong to the server).
  [[nodiscard]] virtual EmulatorReport report() const = 0;
  /// The newest counter samples, oldest first.
  [[nodiscard]] virtual std::vector<CounterSample> samples() const = 0;
};

/// The device that the profile describes, powered up at `start`.
/// @throws std::invalid_argument for a profile that can't be emulated.
std::unique_ptr<EmulatedDevice> make_emulated_device(const DeviceOptions& options,
                                                     rt::TimePoint start);

}  // namespace forcegrid::emulator
