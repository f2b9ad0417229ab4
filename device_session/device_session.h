// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::session {
#pragma GCC visibility push(default)

/// A session that can't be opened. what() names the device, the reason and the remedy.
class SessionError : public std::runtime_error {
 public:
  enum class Reason : std::uint8_t {
    kUnusable,  ///< an option, a profile or a URL that can't be used
    kAbsent,    ///< no such device, or it does not answer
    kInUse,     ///< another program, or another session of this one, has it
  };
  SessionError(Reason reason, const std::string& what)
      : std::runtime_error(what), reason_(reason) {}
  [[nodiscard]] Reason reason() const noexcept { return reason_; }

 private:
  Reason reason_;
};

struct SessionOptions {
  /// As `forcegrid run --device` takes it: a URL (driver/device_url.h), or emulated:PROFILE, which
  /// starts an emulator of its own.
  std::string device = "emulated:woodenhaptics_v2015";
  std::string profile;    ///< name or TOML file; empty: the device's own, else woodenhaptics_v2015
  double rate_Hz = 1000;  ///< of the motor thread, 100 to 4000
  /// Empty: commanded forces are rendered as they are. Else a force method ("auto"): push_sample()
  /// gives it forces, and it renders them at rate_Hz.
  std::string method;
  /// The counters are absolute already. False: an arm waits for its calibration button or
  /// calibrate_now(), a Falcon for its homing; see SessionHealth::kUncalibrated. Emulated devices
  /// always are.
  bool calibrated = false;
  std::string falcon_firmware;  ///< file to load into a Falcon that runs none; empty: none
  bool check_motors = true;     ///< before the first force, see servo::MotorCheck
  bool gravity_compensation = false;
  double ramp_in_s = 0.2;  ///< from no force to the whole force, whenever force is switched on
  bool realtime = true;    ///< ask for SCHED_FIFO for motor and I/O thread
  /// How long a call of open() may take to find the device's first report.
  rt::Duration open_timeout = std::chrono::seconds(2);
  /// A callback (busy()) that has lasted longer than this gets zero force. With a method
  /// use some 200 ms: a slow program computes for long.
  rt::Duration longest_callback = std::chrono::milliseconds(50);
  std::string emulator_hand = "firm";     ///< emulated devices: firm, light, none
  std::string emulator_motion = "still";  ///< emulated devices: as `forcegrid emulate --motion`
  std::string emulator_wrist = "still";   ///< emulated devices: as `forcegrid emulate --wrist`
  double emulator_click_every_s = 0.0;    ///< emulated devices: as --click-every
  std::string emulator_summary;           ///< file for the emulator's summary (JSON); empty: none
  /// File for the times of the motor thread's cycles, written at the end, see MotorTiming; empty:
  /// the one that $FORCEGRID_TIMING names, if it is set.
  std::string timing_file;
  std::function<void(const std::string&)> notice;  ///< what the user should know; may be empty
};

/// Where the tool is and what the motors do, after one cycle of the motor thread. Frame D: x toward
/// the user, y to the user's right, z up. Plain data.
struct ToolState {
  std::uint64_t cycle = 0;   ///< 1 for the first; 0: none yet
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC at the start of the cycle
  std::array<double, 3> position_D_m{};
  std::array<double, 3> velocity_D_m_per_s{};
  bool has_orientation = false;  ///< the device has a wrist; else the identity and zeros follow
  std::array<double, 4> orientation_DT_wxyz{1.0, 0.0, 0.0, 0.0};  ///< tool frame to D, w >= 0
  std::array<double, 3> angular_velocity_D_rad_per_s{};           ///< of the tool frame
  std::array<double, 3> gimbal_angle_rad{};  ///< of the wrist's joints from the arm outward
  std::array<double, 3> joint_angle_rad{};
  std::array<double, 9> jacobian_D_m_per_rad{};   ///< row-major d(position)/dq
  std::array<double, 3> commanded_force_D_N{};    ///< after every limit
  std::array<double, 3> commanded_torque_D_Nm{};  ///< after every limit; zero without such motors
  std::array<double, 3> current_A{};
  std::array<std::int32_t, 6> counts{};
  double motor_warmth = 0.0;           ///< of the warmest, 1: its limit
  double force_gain = 0.0;             ///< ramp and fade, 0..1
  std::uint32_t buttons = 0;           ///< bit i: button i+1; of a stylus: button 1
  std::uint32_t limits_acted = 0;      ///< driver::LimitFlag bits
  std::uint32_t missed_deadlines = 0;  ///< in all
  std::uint8_t held_back = 0;          ///< servo::HeldBack
  std::uint8_t fault = 0;              ///< servo::Fault; the cycle with a fault is the last
};

enum class SessionHealth : std::uint8_t {
  kRunning,
  kUncalibrated,  ///< as kRunning, but counters are not absolute: forces are held back
  kLost,          ///< the device is gone; it is looked for, forces are held back when it returns
  kFaulted,       ///< a fault that reconnecting does not mend; see failure()
  kClosed,
};

/// One haptic device in use by a program: a motor thread of its own runs servo::ServoLoop at
/// rate_Hz with all its limits, guards and faults, whatever the program's threads do. The program
/// reads newest_state() and hands over forces with command_force(), or samples with push_sample().
///
/// No force is rendered before enable_force(true). A force is held for as long as its call says,
/// then it falls to zero within 100 ms. Switching off gives zero in the next cycle.
///
/// After an unplugged cable or a device that fell silent the session looks for it again, every
/// 50 ms; once it is back states go on, and force stays off until it is enabled anew.
///
/// Threads: every function from any thread; command_force(), push_sample(), busy() and idle() from
/// one thread at a time. Real-time: functions marked so neither allocate, lock nor throw.
class DeviceSession {
 public:
  /// Opens the device and starts its motor thread; the first state is there when this returns.
  /// @throws SessionError.
  static std::unique_ptr<DeviceSession> open(const SessionOptions& options);
  virtual ~DeviceSession() = default;

  [[nodiscard]] virtual const profiles::DeviceProfile& profile() const noexcept = 0;
  [[nodiscard]] virtual std::string url() const = 0;  ///< what was opened
  [[nodiscard]] virtual std::string serial() const = 0;
  [[nodiscard]] virtual std::string manufacturer() const = 0;
  [[nodiscard]] virtual std::string product() const = 0;

  /// Real-time.
  [[nodiscard]] virtual ToolState newest_state() const noexcept = 0;
  /// Waits until a cycle after number `cycle` has ended, or `deadline`. Returns some 0.1 ms after
  /// that cycle began; the motor thread does nothing for it. @returns whether one has.
  virtual bool wait_for_cycle(std::uint64_t cycle, rt::TimePoint deadline) noexcept = 0;

  /// Real-time. Off: zero force in the next cycle. On: the force begins at zero and ramps in.
  virtual void enable_force(bool on) noexcept = 0;
  [[nodiscard]] virtual bool force_enabled() const noexcept = 0;
  /// Real-time. The force of the device on the hand from now on, for `hold`, then falling to zero.
  /// Non-finite: refused. Longer than the profile's largest force: shortened, with its direction.
  /// @returns whether it was taken.
  bool command_force(const std::array<double, 3>& force_D_N, rt::Duration hold) noexcept {
    return command_wrench(force_D_N, {}, hold);
  }
  /// Real-time. The same, and the torque about the tip. A device without motors in its wrist takes
  /// it and exerts none.
  virtual bool command_wrench(const std::array<double, 3>& force_D_N,
                              const std::array<double, 3>& torque_D_Nm,
                              rt::Duration hold) noexcept = 0;
  /// Real-time. One force of the object at a place of the tool, for SessionOptions::method.
  /// @param time_ns CLOCK_MONOTONIC, when the tool was there. @returns whether it was taken.
  virtual bool push_sample(std::int64_t time_ns, const std::array<double, 3>& position_D_m,
                           const std::array<double, 3>& force_D_N) noexcept = 0;

  /// Real-time. The program's callback begins, ends. While one lasts longer than
  /// SessionOptions::longest_callback there is zero force.
  virtual void busy() noexcept = 0;
  virtual void idle() noexcept = 0;

  [[nodiscard]] virtual SessionHealth health() const noexcept = 0;
  /// One sentence about why health() is not kRunning; empty while it is.
  [[nodiscard]] virtual std::string failure() const = 0;

  /// Sets the counters of an arm in its calibration pose. @returns why not; empty: done.
  virtual std::string calibrate_now() = 0;

  /// Zero force, then the end of motor thread, device and emulator. Idempotent.
  /// @returns whether zero current is known to have been delivered.
  virtual bool close() noexcept = 0;
};

#pragma GCC visibility pop
}  // namespace forcegrid::session
