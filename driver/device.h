// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "rt/clock.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// A device that can't be found, opened or used. `what()` names the device, what happened in the
/// system's words, and the remedy.
class DeviceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The same of a device that another program, or another part of this one, has in use.
class DeviceInUse : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

/// One exchanged report, decoded.
struct DeviceReport {
  std::uint64_t sequence = 0;            ///< 1 for the first used report; 0: none yet
  std::array<std::int32_t, 6> counts{};  ///< encoder counts a..f, 16-bit wraps undone
  bool calibration_button = false;       ///< latched by the device until it is calibrated
  std::uint8_t homed = 0;                ///< Falcon: bit i is set when counter i is absolute
  /// Falcon: bit 0 plus (far right), 1 forward, 2 centre, 3 minus. W2 with a stylus that has a
  /// button: bit 0.
  std::uint8_t buttons = 0;
  /// When the OUT that released this report was handed over: the device can't have sampled its
  /// counters before.
  rt::TimePoint sampled_after{};
  /// When the OUT that released this report completed: the device samples its counters then, so
  /// now minus this is the age of the counts. After a lost report it may not be known at once which
  /// OUT that was: `released` is of the newest that it can be, the two others are of the oldest.
  rt::TimePoint released{};
  rt::TimePoint oldest_release{};
  rt::TimePoint received{};  ///< when the report arrived at the host
};

/// The motors' torque until the next command, in two units. A device uses the unit that its
/// protocol carries: W2 currents, the Falcon joint torques.
struct MotorCommand {
  std::array<double, 3> current_A{};
  std::array<double, 3> joint_torque_Nm{};
  std::array<double, 3> wrist_current_A{};  ///< of the motors in a wrist; W6 alone has them
  /// When the servo will read the next report. Until then the I/O thread starts no exchange that
  /// would not be finished by that time. Zero (the clock's epoch): unknown.
  rt::TimePoint next_read{};
};

enum class DeviceHealth : std::uint8_t {
  kRunning,
  kStale,         ///< connected, but no report for longer than the time-out
  kUnplugged,     ///< the transport ended
  kTaken,         ///< still on the bus, but another program took its interface
  kSecondWriter,  ///< it answers commands of another program
  kProtocol,      ///< something arrived that the protocol does not allow
  kClosed,        ///< stop() was called
};

/// [static text, lower case] e.g. "device unplugged".
const char* to_string(DeviceHealth health) noexcept;

struct DeviceIdentity {
  std::string url;  ///< what was opened, e.g. "usbip://127.0.0.1:3240/1-1"
  std::string manufacturer;
  std::string product;
  std::string serial;
};

/// Counted since opening.
struct DeviceStatistics {
  std::uint64_t reports_received = 0;   ///< valid ones
  std::uint64_t reports_rejected = 0;   ///< wrong length or otherwise not usable
  std::uint64_t reports_drained = 0;    ///< queued ones that were skipped in favour of a newer one
  std::uint64_t reports_discarded = 0;  ///< read while opening or stopping, and not used
  std::uint64_t reports_lost = 0;       ///< exchanges whose report never came (a kick was needed)
  std::uint64_t reports_late = 0;       ///< came more than 4 ms after the OUT that released them
  std::uint64_t reports_unasked = 0;    ///< of those drained: came without an OUT to release them
  std::uint64_t commands_sent = 0;
  std::uint64_t kicks = 0;  ///< zero reports sent to start or restart the exchange
  std::uint64_t commands_starved =
      0;  ///< exchanges sent with zero current since the servo was silent
  std::uint64_t commands_not_finite = 0;  ///< sent as zeros: a current was NaN or infinite
  std::uint64_t commands_clamped = 0;     ///< a current was beyond the profile's limit
  std::uint64_t refreshes = 0;  ///< exchanges begun without a new command, to renew the counts
};

/// Adds the counts of another opening of the device.
void add(DeviceStatistics& sum, const DeviceStatistics& more) noexcept;

/// A haptic device as the servo loop sees it: newest counts in, currents out. The handle and all
/// blocking calls are on an I/O thread of the implementation's own; the servo meets it in lock-free
/// mailboxes. The I/O thread by itself sends zero current when the servo falls silent for
/// longer than 50 ms.
class Device {
 public:
  virtual ~Device() = default;

  virtual const DeviceIdentity& identity() const noexcept = 0;

  /// The newest report, which stays the same until a newer one comes (see `sequence`).
  /// Real-time: wait-free. Threads: one caller at a time (servo, or set-up before it).
  [[nodiscard]] virtual DeviceReport newest_report() noexcept = 0;

  /// Hands the command to the I/O thread, which sends them with its next exchange. Non-finite or
  /// out-of-limit currents never leave: the I/O side sends zero for a non-finite one and clamps in
  /// double before narrowing.
  /// Real-time: wait-free but for one non-blocking wake-up call. Threads: as newest_report().
  virtual void command(const MotorCommand& command) noexcept = 0;

  /// Real-time: wait-free. Threads: any.
  [[nodiscard]] virtual DeviceHealth health() const noexcept = 0;
  [[nodiscard]] virtual DeviceStatistics statistics() const noexcept = 0;

  /// One sentence about why health() is not kRunning; empty while it is.
  /// Real-time: no. Threads: any.
  [[nodiscard]] virtual std::string failure() const = 0;

  /// Loads the encoder counters (the arm must be in its calibration pose) and waits until a
  /// report shows them. Motors get zero current meanwhile.
  /// @throws DeviceError when the device does not take them within `timeout`.
  /// Real-time: no; before the loop.
  virtual void load_counters(const std::array<std::int16_t, 6>& counts,
                             rt::Duration timeout = std::chrono::seconds(2)) = 0;

  /// Sends zero current, waits until the device has answered it or 200 ms have passed, then closes
  /// the handle and joins the I/O thread. Idempotent; the destructor of every implementation calls
  /// it.
  /// @returns true when the zero command is known to have been delivered.
  virtual bool stop() noexcept = 0;
};

#pragma GCC visibility pop
}  // namespace forcegrid::driver
