// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "device_emulator/emulated_device.h"
#include "device_emulator/fault_spec.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Injects faults between the firmware and the plug of an emulated device: in packets, endpoints,
/// descriptors, power and plug of any device; in counters and motors of devices whose packets it
/// can read (protocols w2, w3, w6 and falcon); in the serial chip and boot loader of a Falcon.
///
/// The report records every fault that has begun, with the time until the motors had no current.
///
/// Real-time: as EmulatedDevice, except run(), which copies packets. Threads: one.
class FaultyDevice final : public EmulatedDevice, private BootLoaderFaults {
 public:
  /// @param profile of the device.
  /// @throws std::invalid_argument for a fault that a device of this protocol can't have, naming
  ///         both.
  FaultyDevice(std::unique_ptr<EmulatedDevice> device, const profiles::DeviceProfile& profile,
               const std::vector<FaultSpec>& faults, rt::TimePoint start);
  ~FaultyDevice() override;

  [[nodiscard]] UsbIdentity identity() const noexcept override { return device_->identity(); }
  [[nodiscard]] std::span<const UsbEndpoint> endpoints() const noexcept override {
    return device_->endpoints();
  }
  [[nodiscard]] bool configured() const noexcept override { return device_->configured(); }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept override;
  ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                       rt::TimePoint now) override;
  void run(rt::TimePoint now, UsbHost& host) override;
  [[nodiscard]] std::optional<rt::TimePoint> wake_time() const noexcept override;
  void advance_to(rt::TimePoint now) noexcept override;
  void bus_reset(rt::TimePoint now) noexcept override;
  void power_cycle(rt::TimePoint now) noexcept override { device_->power_cycle(now); }
  void press_calibration_button() noexcept override { device_->press_calibration_button(); }
  void point_hand_at(const std::optional<Eigen::Vector3d>& pointer_D) noexcept override {
    device_->point_hand_at(pointer_D);
  }
  void hold_with(HandKind hand) noexcept override { device_->hold_with(hand); }
  [[nodiscard]] bool motors_on() const override { return device_->motors_on(); }
  [[nodiscard]] bool plugged_in() const noexcept override { return plugged_in_; }
  [[nodiscard]] EmulatorReport report() const override;
  [[nodiscard]] std::vector<CounterSample> samples() const override { return device_->samples(); }

 private:
  struct Fault;
  class Host;
  class Counters;

  // BootLoaderFaults, as the device's boot loader asks.
  std::uint8_t echo(std::uint64_t image_byte, std::uint8_t character) noexcept override;
  bool stuck_at(BootStep step) noexcept override;

  void begin_what_is_due(rt::TimePoint now);
  [[nodiscard]] const Fault* active(FaultKind kind) const noexcept;
  [[nodiscard]] Fault* acting(FaultKind kind) noexcept;
  /// Whether a fault that acts on single reports acts on this one.
  [[nodiscard]] bool hits(Fault& fault);
  /// Where the counters of each report in `packet` are, behind `prefix` bytes.
  [[nodiscard]] std::vector<Counters> counters_in(std::span<std::uint8_t> packet,
                                                  std::size_t prefix) const;
  void spoil_counters(std::vector<std::uint8_t>& report);
  void spoil_bytes(std::vector<std::uint8_t>& report);
  /// @returns what give_in() returns to the device.
  bool give_in(UsbHost& host, std::uint8_t endpoint_address, std::span<const std::uint8_t> packet);
  std::span<const std::uint8_t> spoil_out(std::span<const std::uint8_t> packet);
  /// Turns the commands in out_ round that `wrong_way` touches.
  void turn_commands(const Fault& wrong_way);
  void deliver_late_reports(UsbHost& host);

  struct LateReport {
    rt::TimePoint due{};
    std::uint8_t endpoint_address = 0;
    std::vector<std::uint8_t> bytes;
  };

  std::unique_ptr<EmulatedDevice> device_;
  std::optional<std::array<int, 3>> wrist_motors_;  ///< counters of the joints that they turn
  bool has_modem_status_;  ///< each IN packet begins with the two status bytes of a serial chip
  std::vector<Fault> faults_;
  rt::TimePoint now_;
  std::optional<rt::TimePoint> first_configured_;
  std::optional<rt::TimePoint> motors_on_since_;
  std::optional<rt::TimePoint> motors_last_on_;
  rt::TimePoint busy_until_{};
  rt::TimePoint unplugged_until_{};
  bool plugged_in_ = true;
  std::uint64_t attachments_ = 0;
  std::deque<LateReport> late_;
  std::vector<std::uint8_t> out_;  ///< the host's packet, as corrupted
};

}  // namespace forcegrid::emulator
