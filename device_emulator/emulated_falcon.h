// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "device_emulator/counter_samples.h"
#include "device_emulator/delta_model.h"
#include "device_emulator/emulated_device.h"
#include "device_emulator/falcon_firmware.h"
#include "device_emulator/ft232r.h"
#include "device_emulator/ft232r_usb.h"
#include "device_emulator/operator_script.h"

namespace forcegrid::emulator {

/// One Novint Falcon behind its plug: FT232R, serial line, signal processor, motors, delta
/// mechanism, hand and operator.
///
/// The knob starts at rest kStartHeight_m above the middle of the workspace. Motor torque at driven
/// angle i is tau_i = -command_i / torque_gain. The operator homes the device by pulling the knob
/// all the way out and pushing it all the way in. The firmware and the counters have their own
/// power supply: a bus reset, or a host that comes and goes, does not affect them.
///
/// Real-time and threads: as EmulatedDevice.
class EmulatedFalcon final : public EmulatedDevice,
                             private SerialPeer,
                             private FalconFirmware::Board {
 public:
  static constexpr double kStartHeight_m = 0.010;
  /// How long a person holds a button down.
  static constexpr rt::Duration kButtonPress = std::chrono::milliseconds(200);

  /// @throws std::invalid_argument for a profile that can't be emulated.
  EmulatedFalcon(const DeviceOptions& options, rt::TimePoint start);
  EmulatedFalcon(const EmulatedFalcon&) = delete;  // its parts refer to each other
  EmulatedFalcon& operator=(const EmulatedFalcon&) = delete;

  [[nodiscard]] UsbIdentity identity() const noexcept override { return usb_.identity(); }
  [[nodiscard]] std::span<const UsbEndpoint> endpoints() const noexcept override {
    return usb_.endpoints();
  }
  [[nodiscard]] bool configured() const noexcept override { return usb_.configured(); }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept override {
    return usb_.halted(endpoint_address);
  }
  ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                       rt::TimePoint now) override;
  void run(rt::TimePoint now, UsbHost& host) override;
  [[nodiscard]] std::optional<rt::TimePoint> wake_time() const noexcept override {
    return bridge_.wake_time();
  }
  /// A watchdog that trips before `now` cuts the motors at its own time, and a packet that arrives
  /// before `now` is answered at its own.
  void advance_to(rt::TimePoint now) noexcept override;
  /// Resets the FT232R as opening it does: lines low, FIFOs empty, latency 16 ms.
  void bus_reset(rt::TimePoint now) noexcept override;
  /// Cycles both power supplies: the firmware must be loaded again.
  void power_cycle(rt::TimePoint now) noexcept override;
  [[nodiscard]] bool motors_on() const override;
  void set_boot_loader_faults(BootLoaderFaults* faults) noexcept override {
    firmware_.set_boot_loader_faults(faults);
  }
  /// The centre button, for kButtonPress.
  void press_calibration_button() noexcept override;

  void point_hand_at(const std::optional<Eigen::Vector3d>& pointer_D) noexcept override {
    pointer_D_ = pointer_D;
  }
  void hold_with(HandKind hand) noexcept override;

  [[nodiscard]] EmulatorReport report() const override;
  [[nodiscard]] std::vector<CounterSample> samples() const override { return samples_.newest(); }

  [[nodiscard]] const Ft232r& bridge() const noexcept { return bridge_; }
  [[nodiscard]] const FalconFirmware& firmware() const noexcept { return firmware_; }
  [[nodiscard]] const DeltaModel& delta() const noexcept { return delta_; }
  [[nodiscard]] OperatorScript::Phase operator_phase() const noexcept { return script_.phase(); }
  /// [N m] of the motors at the driven angles.
  [[nodiscard]] Eigen::Vector3d torque_Nm() const noexcept;

 private:
  // SerialPeer: the bridge's characters arrive here on their way to the firmware.
  void receive(std::uint8_t character, const LineSettings& line,
               rt::TimePoint time) noexcept override;
  void modem_lines_changed(const LineSettings& line, rt::TimePoint time) noexcept override;
  // FalconFirmware::Board
  std::array<double, 3> joint_angle_rad(rt::TimePoint time) noexcept override;
  void send(std::span<const std::uint8_t> characters, double baud_Hz,
            rt::TimePoint start) noexcept override;

  void advance_physics(rt::TimePoint now) noexcept;

  std::string name_;
  double torque_gain_per_Nm_;
  Ft232rUsb usb_;
  Ft232r bridge_;
  FalconFirmware firmware_;
  DeltaModel delta_;
  OperatorScript script_;
  Hands hands_;
  HandKind hand_;
  std::optional<Eigen::Vector3d> pointer_D_;

  rt::TimePoint now_;
  std::optional<rt::TimePoint> button_until_;
  std::array<std::int32_t, 3> max_abs_command_{};
  std::optional<rt::TimePoint> motors_last_nonzero_;
  double physics_skipped_s_ = 0.0;
  CounterSamples samples_;
};

}  // namespace forcegrid::emulator
