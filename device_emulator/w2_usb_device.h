#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "device_emulator/usb.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Endpoint 0 of a W2 device: descriptors, strings and the answers to control requests, with the
/// STALLs of the mbed USB library that the real firmware is built on. Interrupt endpoints are
/// EP1 IN (0x81) and EP1 OUT (0x01); their contents belong to W2Firmware.
///
/// Numbers, strings, usage and report size come from the profile; everything else is fixed.
/// Source: woody-experimental `mbed-code/WoodenHapticsHID/USBDevice` (mbed 53949e6131f6), by way of
/// its fact sheet.
/// Real-time: no (answers are byte vectors). Threads: one.
class W2UsbDevice {
 public:
  static constexpr std::uint8_t kEndpointIn = 0x81;
  static constexpr std::uint8_t kEndpointOut = 0x01;

  /// @throws std::invalid_argument when the profile's protocol is not "w2", its reports are not of
  ///         14 bytes, or a string has a non-ASCII character or more than 126 characters.
  explicit W2UsbDevice(const profiles::DeviceProfile::Usb& usb);

  /// Executes one control transfer. `data` is what the host sent in the data stage.
  [[nodiscard]] ControlReply control(const SetupPacket& setup, std::span<const std::uint8_t> data);

  /// Back to attached, unconfigured, nothing halted.
  void bus_reset() noexcept;

  [[nodiscard]] bool configured() const noexcept { return configuration_ != 0; }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept;

  [[nodiscard]] const std::array<std::uint8_t, 18>& device_descriptor() const noexcept {
    return device_descriptor_;
  }
  [[nodiscard]] const std::vector<std::uint8_t>& configuration_descriptor() const noexcept {
    return configuration_descriptor_;
  }
  [[nodiscard]] const std::vector<std::uint8_t>& report_descriptor() const noexcept {
    return report_descriptor_;
  }

 private:
  ControlReply standard(const SetupPacket& setup);
  ControlReply get_descriptor(const SetupPacket& setup) const;

  std::array<std::uint8_t, 18> device_descriptor_{};
  std::vector<std::uint8_t> configuration_descriptor_;
  std::vector<std::uint8_t> report_descriptor_;
  std::array<std::vector<std::uint8_t>, 6> string_descriptors_;
  std::uint8_t configuration_ = 0;
  bool in_halted_ = false;
  bool out_halted_ = false;
};

}  // namespace forcegrid::emulator
