// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
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
/// allocate by themselves (a UsbHost that they call may). Threads: one.
class EmulatedDevice {
 public:
  /// A longer gap between two calls (the process was stopped) is not integrated but counted.
  static constexpr rt::Duration kLongestStep = std::chrono::seconds(1);
  /// The mechanism moves at least this often while time passes without a transfer.
  static constexpr rt::Duration kPhysicsChunk = std::chrono::milliseconds(1);
  /// A host that is silent for longer has gone; the hand waits for the next one.
  static constexpr rt::Duration kHostGone = std::chrono::seconds(2);

  virtual ~EmulatedDevice() = default;

  [[nodiscard]] virtual UsbIdentity identity() const noexcept = 0;
  /// All endpoints except endpoint 0; they stay the same for the device's life.
  [[nodiscard]] virtual std::span<const UsbEndpoint> endpoints() const noexcept = 0;
  [[nodiscard]] virtual bool configured() const noexcept = 0;
  /// Whether an endpoint answers STALL.
  [[nodiscard]] virtual bool halted(std::uint8_t endpoint_address) const noexcept = 0;

  /// A control transfer on endpoint 0, answered at once. `data` is what the host sent in the data
  /// stage. May allocate.
  virtual ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                               rt::TimePoint now) = 0;

  /// Moves the packets that device and host have for each other at `now`. Called in every bus
  /// frame; for a device with a bulk endpoint also between frames, when the host has submitted
  /// something and at wake_time(). The host has no packets for, and asks for none from, halted
  /// endpoints or a device that is not configured.
  virtual void run(rt::TimePoint now, UsbHost& host) = 0;

  /// When a bulk endpoint that the host asks will have a packet for it; nothing if only the host
  /// can change that.
  [[nodiscard]] virtual std::optional<rt::TimePoint> wake_time() const noexcept {
    return std::nullopt;
  }

  /// Physics, operator and watchdog up to `now`.
  virtual void advance_to(rt::TimePoint now) noexcept = 0;

  /// The host lets go of the device; it continues under its own power.
  virtual void bus_reset(rt::TimePoint now) noexcept = 0;

  /// Power fails and returns at once: the firmware restarts without its state; the arm and the
  /// person continue. A device that keeps no state in its firmware gets a bus reset only.
  virtual void power_cycle(rt::TimePoint now) noexcept { bus_reset(now); }

  /// Whether a motor has current.
  [[nodiscard]] virtual bool motors_on() const;

  /// Whether the cable is plugged in. Otherwise the device is not listed and cannot be imported,
  /// and a client that has imported it is cut off.
  [[nodiscard]] virtual bool plugged_in() const noexcept { return true; }

  /// The person presses the device's button for calibration; no effect on a device without one.
  virtual void press_calibration_button() noexcept {}

  /// Where somebody wants the hand from now on, [m] frame D, finite; nothing: the operator's script
  /// goes on. See OperatorScript; no effect on a device that no hand holds.
  virtual void point_hand_at(const std::optional<Eigen::Vector3d>& pointer_D) noexcept = 0;

  /// Another hand holds the device from now on, see HeldMechanism::change_hand(). One that takes a
  /// device that nothing held takes the tip where it is.
  virtual void hold_with(HandKind hand) noexcept = 0;

  /// From now on `faults`, which outlives the device or is null, decides the faults of its boot
  /// loader; no effect on a device without one.
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
