// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "device_emulator/ft232r.h"
#include "device_emulator/ft232r_eeprom.h"
#include "device_emulator/usb.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// Endpoint 0 of an FT232R: descriptors, strings, standard requests, and the vendor requests that
/// set the bridge. One interface (0) of class FF with bulk IN 0x81 and bulk OUT 0x02, 64 bytes
/// each, full speed, EP0 of 8 bytes, bus-powered with remote wake-up.
///
/// It is in configuration 1 from the start and after a bus reset: a USB/IP host hands over a device
/// in that state, and clients of this chip use it without SET_CONFIGURATION.
///
/// Vendor requests: reset and purge (0), modem control (1), flow control (2), baud rate (3), data
/// format (4), modem status (5), event and error character (6, 7), latency timer (9, 0x0A), bit
/// mode (0x0B), pins (0x0C), EEPROM word (0x90; addresses repeat every 64 words). Others, including
/// EEPROM writes, and values that mean nothing to the chip are answered STALL.
///
/// Numbers and strings come from the profile; everything else is fixed.
/// Source: Linux `drivers/usb/serial/ftdi_sio.h`, by way of the device's fact sheet; USB 2.0,
/// chapter 9. Real-time: no (answers are byte vectors). Threads: one.
class Ft232rUsb {
 public:
  static constexpr std::uint8_t kEndpointIn = 0x81;
  static constexpr std::uint8_t kEndpointOut = 0x02;

  /// @throws std::invalid_argument when a string has a non-ASCII character, or when the strings
  ///         are too long for the chip's EEPROM.
  explicit Ft232rUsb(const profiles::DeviceProfile::Usb& usb);

  /// Executes one control transfer; settings go to `bridge`, and from there to `peer`.
  [[nodiscard]] ControlReply control(const SetupPacket& setup, Ft232r& bridge, SerialPeer& peer,
                                     rt::TimePoint now);

  /// Nothing halted, configuration 1.
  void bus_reset() noexcept;

  [[nodiscard]] const UsbIdentity& identity() const noexcept { return identity_; }
  [[nodiscard]] std::span<const UsbEndpoint> endpoints() const noexcept;
  [[nodiscard]] bool configured() const noexcept { return configuration_ != 0; }
  [[nodiscard]] bool halted(std::uint8_t endpoint_address) const noexcept {
    return (endpoint_address == kEndpointIn && in_halted_) ||
           (endpoint_address == kEndpointOut && out_halted_);
  }

 private:
  ControlReply standard(const SetupPacket& setup);
  ControlReply get_descriptor(const SetupPacket& setup) const;
  ControlReply vendor_out(const SetupPacket& setup, Ft232r& bridge, SerialPeer& peer,
                          rt::TimePoint now) const;
  ControlReply vendor_in(const SetupPacket& setup, const Ft232r& bridge) const;

  UsbIdentity identity_;
  std::array<std::uint8_t, 18> device_descriptor_{};
  std::array<std::vector<std::uint8_t>, 4> string_descriptors_;
  Ft232rEeprom eeprom_;
  std::uint8_t configuration_ = 1;
  bool remote_wakeup_ = false;
  bool in_halted_ = false;
  bool out_halted_ = false;
};

}  // namespace forcegrid::emulator
