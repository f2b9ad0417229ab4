// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace forcegrid::emulator {

/// The eight bytes that open a control transfer (USB 2.0, section 9.3).
struct SetupPacket {
  std::uint8_t request_type = 0;
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
  std::uint16_t length = 0;

  /// From the wire, where the three words are little-endian.
  static SetupPacket from_bytes(std::span<const std::uint8_t, 8> bytes) noexcept;
  [[nodiscard]] bool device_to_host() const noexcept { return (request_type & 0x80U) != 0; }
};

/// How a control transfer ended.
struct ControlReply {
  bool stalled = true;
  std::vector<std::uint8_t> data;  ///< of a device-to-host transfer, at most `length` bytes
};

/// What a device list states about a device before anybody has talked to it.
struct UsbIdentity {
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::uint16_t device_release = 0;  ///< bcdDevice
  std::uint8_t interfaces = 1;       ///< all of the same class, subclass and protocol
  std::uint8_t interface_class = 0;
  std::uint8_t interface_subclass = 0;
  std::uint8_t interface_protocol = 0;
};

/// How often a host asks an endpoint.
enum class UsbTransferType : std::uint8_t {
  kInterrupt,  ///< once per bus frame
  kBulk,       ///< whenever the bus is free
};

/// One endpoint other than endpoint 0.
struct UsbEndpoint {
  std::uint8_t address = 0;  ///< number, and 0x80 for IN
  UsbTransferType type = UsbTransferType::kInterrupt;
  std::size_t packet_bytes = 0;  ///< wMaxPacketSize

  [[nodiscard]] bool in() const noexcept { return (address & 0x80U) != 0; }
};

/// The host's end of the bus at one moment: which packets it has for a device and which it asks
/// for. A device that leaves a packet has answered NAK.
class UsbHost {
 public:
  virtual ~UsbHost() = default;

  /// The packet that the host sends to an OUT endpoint, at most packet_bytes long and possibly
  /// empty; nothing if it sends none. Valid until the next call of a member.
  [[nodiscard]] virtual std::optional<std::span<const std::uint8_t>> out_packet(
      std::uint8_t endpoint_address) = 0;
  /// The device has taken that packet (ACK); the next one, if any, comes after it.
  virtual void take_out(std::uint8_t endpoint_address) = 0;

  /// Whether the host asks an IN endpoint for a packet.
  [[nodiscard]] virtual bool wants_in(std::uint8_t endpoint_address) = 0;
  /// Answers with a packet of at most packet_bytes; only after wants_in(). One that is shorter than
  /// packet_bytes ends the host's transfer.
  /// @returns false when the host has no room for it (babble): its transfer has failed, there was
  ///          no handshake, and the device still has its packet.
  [[nodiscard]] virtual bool give_in(std::uint8_t endpoint_address,
                                     std::span<const std::uint8_t> packet) = 0;
  /// Ends the host's transfer as if the device had sent more than there was room for; only after
  /// wants_in().
  virtual void babble(std::uint8_t endpoint_address) = 0;
  /// Ends the host's transfer with more bytes than it asked for. No bus can do that, but a server
  /// in between can; only after wants_in().
  virtual void overfill(std::uint8_t endpoint_address) = 0;
};

/// String descriptor of printable ASCII.
/// @throws std::invalid_argument for any other character or more than 126 of them.
std::vector<std::uint8_t> usb_string_descriptor(const std::string& text);

}  // namespace forcegrid::emulator
