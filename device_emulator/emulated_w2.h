// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "device_emulator/arm_model.h"
#include "device_emulator/core_line.h"
#include "device_emulator/counter_samples.h"
#include "device_emulator/driven_wrist.h"
#include "device_emulator/emulated_device.h"
#include "device_emulator/operator_script.h"
#include "device_emulator/w2_firmware.h"
#include "device_emulator/w2_usb_device.h"
#include "device_emulator/wrist.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// One W2 or W3 device behind its plug: endpoint 0, firmware, amplifiers, motors, arm, hand and
/// operator. The arm starts at rest in the calibration pose. Motor torque at joint i is tau_i = s_i
/// k_i I_i D_i / d_i with I_i = I_full (duty_i - 0.5) / 0.4 for a duty within 10..90 %. The servo
/// amplifier (ESCON) treats any other duty as out of range: zero current, counted.
///
/// A wrist's joints are where the hand turns them, within their stops; see Wrist. One with motors
/// moves by its physics; see DrivenWrist.
///
/// With DeviceOptions::core, a second processor computes the currents: every kCorePeriod, while the
/// host sends reports and the counters are true, it is sent the counters, and its newest answer
/// drives the motors. If it or the host is silent for kCoreSilence, and when the host lets go of
/// the device, the currents are zero.
///
/// Real-time and threads: as EmulatedDevice.
class EmulatedW2 final : public EmulatedDevice {
 public:
  static constexpr rt::Duration kCorePeriod = std::chrono::milliseconds(2);
  static constexpr rt::Duration kCoreSilence = std::chrono::milliseconds(50);

  /// @throws std::invalid_argument for a profile that can't be emulated (see W2UsbDevice);
  ///         EmulatorError if there is no processor at DeviceOptions::core.
  EmulatedW2(const DeviceOptions& options, rt::TimePoint start);

  [[nodiscard]] UsbIdentity identity() const noexcept override;
  [[nodiscard]] std::span<const UsbEndpoint> endpoints() const noexcept override;
  [[nodiscard]] bool configured() const noexcept override { return usb_.configured(); }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept override {
    return usb_.halted(endpoint_address);
  }
  ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                       rt::TimePoint now) override;

  /// One bus frame: at most one packet each way, in the chosen frame order.
  void run(rt::TimePoint now, UsbHost& host) override;

  /// A watchdog that trips before `now` cuts the current at its own time.
  void advance_to(rt::TimePoint now) noexcept override;

  /// Attached and unconfigured. Counters and calibration survive; the watchdog trips later.
  void bus_reset(rt::TimePoint now) noexcept override;

  void power_cycle(rt::TimePoint now) noexcept override;
  [[nodiscard]] bool motors_on() const override {
    return !current_A_.isZero(0.0) || !wrist_current_A_.isZero(0.0);
  }

  void press_calibration_button() noexcept override { firmware_.press_calibration_button(); }

  void point_hand_at(const std::optional<Eigen::Vector3d>& pointer_D) noexcept override {
    pointer_D_ = pointer_D;
  }
  void hold_with(HandKind hand) noexcept override;

  [[nodiscard]] EmulatorReport report() const override;
  [[nodiscard]] std::vector<CounterSample> samples() const override { return samples_.newest(); }

  [[nodiscard]] const W2UsbDevice& usb() const noexcept { return usb_; }
  [[nodiscard]] const W2Firmware& firmware() const noexcept { return firmware_; }
  [[nodiscard]] const ArmModel& arm() const noexcept { return arm_; }
  /// The tool's frame in D: columns are its axes.
  [[nodiscard]] Eigen::Matrix3d tool_axes_D() const noexcept;
  [[nodiscard]] OperatorScript::Phase operator_phase() const noexcept { return script_.phase(); }
  /// [A] flowing in motors a, b, c.
  [[nodiscard]] const Eigen::Vector3d& current_A() const noexcept { return current_A_; }

 private:
  std::array<std::int64_t, 6> encoder_positions() const noexcept;
  void turn_wrist(const OperatorScript::Action& action, double duration_s) noexcept;
  [[nodiscard]] Eigen::Vector3d linkage_angle_rad() const noexcept;
  [[nodiscard]] Eigen::Vector3d arm_torque_Nm() const noexcept;
  [[nodiscard]] double current_of(std::size_t motor) noexcept;
  void describe_wrist(EmulatorReport& report) const;
  void run_firmware(rt::TimePoint now) noexcept;
  void drive_motors() noexcept;
  void run_core(rt::TimePoint now) noexcept;
  void stop_core() noexcept;
  [[nodiscard]] bool host_reports(rt::TimePoint now) const noexcept;

  UsbIdentity identity_;
  W2UsbDevice usb_;
  W2Firmware firmware_;
  ArmModel arm_;
  Wrist wrist_;
  std::optional<DrivenWrist> driven_wrist_;  ///< nothing: no motors in it
  OperatorScript script_;
  Hands hands_;
  HandKind hand_;
  std::optional<Eigen::Vector3d> pointer_D_;
  FrameOrder frame_order_;
  std::string name_;
  double full_scale_current_A_;
  Eigen::Vector3d torque_per_current_Nm_per_A_;

  bool has_stylus_button_;
  bool stylus_down_ = false;
  std::uint64_t stylus_clicks_ = 0;
  Eigen::Vector3d gimbal_rad_;  ///< joint angles of the wrist
  Eigen::Vector3d wrist_torque_per_current_Nm_per_A_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d wrist_current_A_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d max_abs_wrist_current_A_ = Eigen::Vector3d::Zero();

  rt::TimePoint now_;
  Eigen::Vector3d current_A_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d max_abs_current_A_ = Eigen::Vector3d::Zero();
  std::optional<rt::TimePoint> motors_last_nonzero_;
  std::uint64_t out_of_range_currents_ = 0;
  std::uint64_t reports_applied_ = 0;
  double physics_skipped_s_ = 0.0;
  CounterSamples samples_;

  std::unique_ptr<CoreLine> core_;  ///< null: there is no second processor
  bool counters_are_true_;          ///< from the start; else they are once they have been loaded
  CoreUse core_use_;
  double core_latency_sum_ms_ = 0.0;
  std::array<rt::TimePoint, 16> core_sent_{};   ///< when the state of this number, modulo 16, went
  std::optional<rt::TimePoint> core_answered_;  ///< nothing: silent
};

}  // namespace forcegrid::emulator
