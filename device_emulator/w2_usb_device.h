// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "device_emulator/usb.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Endpoint 0 of a W2 or W3 device: descriptors, strings and the answers to control requests, with
/// the STALLs of the USB library that the real firmware is built on.
///
/// W2 is mbed's library: one HID interface with EP1 IN (0x81) and EP1 OUT (0x01). W3 is Teensy's
/// RawHID: interface 0 with EP3 IN (0x83) and EP4 OUT (0x04) carries the reports, and interface 1
/// is a serial line dressed as HID, which this firmware does not use: its endpoints (EP2 of a
/// high-speed Teensy 4, EP1 IN and EP2 OUT of a full-speed Teensy 3) answer NAK. Contents of the
/// report endpoints belong to W2Firmware.
///
/// Numbers, strings, usage and report size come from the profile; everything else is fixed.
/// Source: woody-experimental `mbed-code/WoodenHapticsHID/USBDevice` (mbed 53949e6131f6), by way of
/// its fact sheet; PaulStoffregen/cores `teensy4/usb_desc.{h,c}`, `teensy4/usb.c`.
/// Real-time: no (answers are byte vectors). Threads: one.
class W2UsbDevice {
 public:
  /// @throws std::invalid_argument unless the profile's protocol is "w2", "w3" or "w6" with reports
  ///         of 14, 64 or 20 bytes ("w6" has W2's descriptors otherwise), or when a string has a
  ///         non-ASCII character or more than 126 characters.
  explicit W2UsbDevice(const profiles::DeviceProfile::Usb& usb);

  /// Executes one control transfer. `data` is what the host sent in the data stage.
  [[nodiscard]] ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data);

  /// Returns to attached, unconfigured, nothing halted.
  void bus_reset() noexcept;

  [[nodiscard]] bool configured() const noexcept { return configuration_ != 0; }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept;
  /// Addresses of the two endpoints that carry reports.
  [[nodiscard]] std::uint8_t endpoint_in() const noexcept { return endpoint_in_; }
  [[nodiscard]] std::uint8_t endpoint_out() const noexcept { return endpoint_out_; }
  /// Every endpoint of the configuration.
  [[nodiscard]] std::span<const UsbEndpoint> endpoints() const noexcept { return endpoints_; }

  [[nodiscard]] const std::array<std::uint8_t, 18>& device_descriptor() const noexcept {
    return device_descriptor_;
  }
  [[nodiscard]] const std::vector<std::uint8_t>& configuration_descriptor() const noexcept {
    return configuration_descriptor_;
  }
  /// Of the interface that carries the reports.
  [[nodiscard]] const std::vector<std::uint8_t>& report_descriptor() const noexcept {
    return report_descriptors_.front();
  }
  [[nodiscard]] std::uint8_t interfaces() const noexcept {
    return static_cast<std::uint8_t>(report_descriptors_.size());
  }

 private:
  void describe_mbed(const profiles::DeviceProfile::Usb& usb);
  void describe_teensy(const profiles::DeviceProfile::Usb& usb);
  ControlReply mbed(const SetupPacket& setup, std::span<const std::uint8_t> data);
  ControlReply mbed_descriptor(const SetupPacket& setup) const;
  ControlReply teensy(const SetupPacket& setup, std::span<const std::uint8_t> data);
  ControlReply teensy_descriptor(const SetupPacket& setup) const;
  ControlReply hid_descriptor(std::size_t interface) const;
  void set_halted(std::uint8_t endpoint_address, bool halted) noexcept;

  bool teensy_ = false;
  bool high_speed_ = false;
  std::uint8_t endpoint_in_ = 0;
  std::uint8_t endpoint_out_ = 0;
  std::vector<UsbEndpoint> endpoints_;
  std::array<std::uint8_t, 18> device_descriptor_{};
  std::vector<std::uint8_t> configuration_descriptor_;
  std::vector<std::size_t> hid_descriptor_offsets_;  ///< in the configuration, by interface
  std::vector<std::vector<std::uint8_t>> report_descriptors_;
  std::vector<std::vector<std::uint8_t>> string_descriptors_;
  std::uint8_t configuration_ = 0;
  std::uint32_t halted_ = 0;  ///< bits 0..15: OUT endpoints, 16..31: IN endpoints
};

}  // namespace forcegrid::emulator
