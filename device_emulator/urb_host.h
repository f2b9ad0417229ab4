// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "device_emulator/usb.h"

namespace forcegrid::emulator {

/// A transfer that a USB/IP client waits for.
struct Urb {
  std::uint32_t sequence = 0;
  UsbEndpoint endpoint;
  std::size_t buffer_bytes = 0;    ///< IN: the client's room
  std::vector<std::uint8_t> data;  ///< OUT: data to send; IN: data received so far
  std::size_t sent_bytes = 0;      ///< OUT: bytes of `data` that the device has taken
  bool zero_packet = false;        ///< OUT: an empty packet follows data of whole packets
  bool short_is_error = false;     ///< IN: less than buffer_bytes is an error
};

/// The host's end of the bus of one USB/IP client: it processes the client's pending transfers
/// packet by packet, the oldest of each endpoint first, and writes the reply when a transfer is
/// complete. An OUT transfer ends with its last packet; an IN transfer with a packet shorter than
/// the endpoint's or with a full buffer.
///
/// Keeps references to the client's lists.
/// Real-time: no (replies are appended to a vector). Threads: one.
class UrbHost final : public UsbHost {
 public:
  /// @param replies RET_SUBMIT messages are appended to it.
  UrbHost(std::vector<Urb>& pending, std::vector<std::uint8_t>& replies) noexcept
      : pending_(pending), replies_(replies) {}

  [[nodiscard]] std::optional<std::span<const std::uint8_t>> out_packet(
      std::uint8_t endpoint_address) override;
  void take_out(std::uint8_t endpoint_address) override;
  [[nodiscard]] bool wants_in(std::uint8_t endpoint_address) override;
  [[nodiscard]] bool give_in(std::uint8_t endpoint_address,
                             std::span<const std::uint8_t> packet) override;

  void babble(std::uint8_t endpoint_address) override;
  void overfill(std::uint8_t endpoint_address) override;

  /// Ends all transfers of an endpoint with a USB/IP status.
  void fail_all(std::uint8_t endpoint_address, std::int32_t status);

 private:
  std::vector<Urb>::iterator first(std::uint8_t endpoint_address);
  void complete(std::vector<Urb>::iterator urb, std::int32_t status);

  std::vector<Urb>& pending_;
  std::vector<std::uint8_t>& replies_;
};

}  // namespace forcegrid::emulator
