#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "device_emulator/arm_model.h"
#include "device_emulator/emulator_report.h"
#include "device_emulator/operator_script.h"
#include "device_emulator/w2_firmware.h"
#include "device_emulator/w2_usb_device.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// Who holds the arm's tip.
enum class HandKind : std::uint8_t { kFirm, kLight, kNone };
/// "firm", "light" or "none". @throws std::invalid_argument for anything else.
HandKind parse_hand(std::string_view name);

/// What happens first within a bus frame.
enum class FrameOrder : std::uint8_t {
  kOutFirst,  ///< OUT, firmware, IN: the answer to a report is collected in the same frame
  kInFirst,   ///< IN, OUT, firmware: the answer is collected one frame later
};
/// "out-first" or "in-first". @throws std::invalid_argument for anything else.
FrameOrder parse_frame_order(std::string_view name);

struct DeviceOptions {
  profiles::DeviceProfile profile;
  HandKind hand = HandKind::kFirm;
  bool hand_carries_weight = true;          ///< see ArmModel
  OperatorScript::Options operator_script;  ///< `calibrated` also starts the counters true
  FrameOrder frame_order = FrameOrder::kOutFirst;
  /// Counters at power-up: false: 0; true: seeded random ones within +-20000.
  bool random_power_up_counters = false;
};

/// One W2 device behind its plug: endpoint 0, firmware, amplifiers, motors, arm, hand and operator.
/// Everything happens at times given by the caller, which must not decrease: simulated in tests,
/// CLOCK_MONOTONIC in the server.
///
/// The arm starts at rest in the calibration pose. Motor torque at joint i is
/// tau_i = s_i k_i I_i D_i / d_i with I_i = I_full (duty_i - 0.5) / 0.4 for a duty within 10..90 %.
/// The servo amplifier (ESCON) treats any other duty as out of range: zero current, counted.
///
/// Real-time: advance_to() and run_frame() neither allocate, lock nor throw. Threads: one.
class EmulatedDevice {
 public:
  /// Number of the newest counter samples kept.
  static constexpr std::size_t kSampleCapacity = 4096;
  /// A longer gap between two calls (the process was stopped) is not integrated but counted.
  static constexpr rt::Duration kLongestStep = std::chrono::seconds(1);

  /// What one bus frame moved.
  struct FrameResult {
    bool out_taken = false;                ///< the OUT packet was acknowledged
    std::optional<W2Firmware::Report> in;  ///< the IN report that the host collected
  };

  /// @throws std::invalid_argument for a profile that can't be emulated (see W2UsbDevice).
  EmulatedDevice(const DeviceOptions& options, rt::TimePoint start);

  /// Physics, operator and watchdog up to `now`; a watchdog that trips in between cuts the current
  /// at its own time.
  void advance_to(rt::TimePoint now) noexcept;

  /// A control transfer on endpoint 0 (answered at once; may allocate).
  W2UsbDevice::ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                                    rt::TimePoint now);

  /// One bus frame: at most one packet each way, in the frame order chosen.
  /// @param out_packet what the host has for EP1 OUT; at most 64 bytes.
  /// @param in_wanted whether the host asks EP1 IN.
  FrameResult run_frame(rt::TimePoint now, std::optional<std::span<const std::uint8_t>> out_packet,
                        bool in_wanted) noexcept;

  /// The host lets go of the device: bus reset, attached and unconfigured. Counters and calibration
  /// survive, and the watchdog will find out.
  void bus_reset(rt::TimePoint now) noexcept;

  void press_calibration_button() noexcept { firmware_.press_calibration_button(); }

  [[nodiscard]] const W2UsbDevice& usb() const noexcept { return usb_; }
  [[nodiscard]] const W2Firmware& firmware() const noexcept { return firmware_; }
  [[nodiscard]] const ArmModel& arm() const noexcept { return arm_; }
  [[nodiscard]] OperatorScript::Phase operator_phase() const noexcept { return script_.phase(); }
  /// [A] flowing in motors a, b, c.
  [[nodiscard]] const Eigen::Vector3d& current_A() const noexcept { return current_A_; }

  /// Device part of the report (frames and attachment belong to the server).
  [[nodiscard]] EmulatorReport report() const;
  /// The newest counter samples, oldest first, at most kSampleCapacity.
  [[nodiscard]] std::vector<CounterSample> samples() const;

 private:
  void run_firmware(rt::TimePoint now) noexcept;
  void drive_motors() noexcept;

  W2UsbDevice usb_;
  W2Firmware firmware_;
  ArmModel arm_;
  OperatorScript script_;
  FrameOrder frame_order_;
  std::string name_;
  double full_scale_current_A_;
  Eigen::Vector3d torque_per_current_Nm_per_A_;

  rt::TimePoint now_;
  Eigen::Vector3d current_A_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d max_abs_current_A_ = Eigen::Vector3d::Zero();
  std::optional<rt::TimePoint> motors_last_nonzero_;
  std::uint64_t out_of_range_currents_ = 0;
  std::uint64_t reports_applied_ = 0;
  double physics_skipped_s_ = 0.0;
  std::vector<CounterSample> samples_;
  std::size_t sample_count_ = 0;
};

}  // namespace forcegrid::emulator
