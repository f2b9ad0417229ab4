// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "driver/bulk_transport.h"

namespace forcegrid::driver::ftdi {

/// How an FT232R divides its 3 MHz: an integer part with eighths.
struct Divisor {
  std::uint16_t value = 0;  ///< wValue of the request
  std::uint16_t index = 0;  ///< wIndex
};

/// The chip's code of a divisor, rounded to the next eighth it has (all of them): integer part in
/// bits 13..0, the code of the fraction in bits 15..14 and in bit 0 of the index. 1 and 1.5, which
/// the code does not reach, have values of their own.
/// @param divisor  1, 1.5, or 2 to 16383.875.
/// Source: Linux drivers/usb/serial/ftdi_sio.h. Real-time: bounded.
[[nodiscard]] Divisor encode_divisor(double divisor) noexcept;

/// Baud rate that a divisor gives: 3e6 / divisor.
[[nodiscard]] constexpr double baud_of(double divisor) noexcept { return 3e6 / divisor; }

/// Takes the two status bytes out of every packet of a transfer, in place.
struct Stripped {
  std::size_t bytes = 0;  ///< data bytes, now at the beginning of the transfer
  bool whole = true;      ///< false: a packet had fewer than two bytes
  std::uint8_t line_errors =
      0;  ///< bits of the line status: 1 overrun, 2 parity, 3 framing, 4 break
};
/// @param packet_bytes  largest packet of the endpoint: a longer transfer has a status in each.
/// Real-time: bounded, no allocation, lock or throw.
[[nodiscard]] Stripped strip_status(std::span<std::uint8_t> transfer,
                                    std::size_t packet_bytes) noexcept;

/// The serial line behind an FTDI FT232R. Functions that set something send one vendor request and
/// wait until the chip has taken it.
/// Threads: one at a time, as the transport's.
class FtdiPort {
 public:
  /// Data bytes that the chip sends in one packet.
  static constexpr std::size_t kMaxDataBytes = BulkTransport::kMaxBulkBytes - 2;

  /// @param timeout  for each request.
  FtdiPort(BulkTransport& transport, rt::Duration timeout)
      : transport_(transport), timeout_(timeout) {}

  /// Empties both FIFOs of the chip, and what the host has received and not read.
  [[nodiscard]] TransportStatus purge() noexcept;
  [[nodiscard]] TransportStatus set_dtr(bool high) noexcept;
  [[nodiscard]] TransportStatus set_rts(bool high) noexcept;
  [[nodiscard]] TransportStatus set_no_flow_control() noexcept;
  [[nodiscard]] TransportStatus set_8n1() noexcept;
  [[nodiscard]] TransportStatus set_divisor(double divisor) noexcept;
  /// After this long the chip sends a packet, with whatever data it has.
  [[nodiscard]] TransportStatus set_latency(std::chrono::milliseconds latency) noexcept;

  struct Read {
    TransportStatus status = TransportStatus::kTimeout;
    std::span<const std::uint8_t> data{};  ///< at least one byte if kOk; valid until the next call
    rt::TimePoint arrived{};
  };
  /// The next packet that has data; bare status packets are passed over.
  /// Real-time: as Transport::read().
  [[nodiscard]] Read read(rt::Duration timeout) noexcept;

  /// Sends at most kMaxBulkBytes bytes.
  [[nodiscard]] WriteResult write(std::span<const std::uint8_t> bytes,
                                  rt::Duration timeout) noexcept {
    return transport_.write(bytes, timeout);
  }

  /// Packets since the start: with nothing but status; too short to have one; with line errors.
  std::uint64_t status_only_packets() const noexcept { return status_only_packets_; }
  std::uint64_t short_packets() const noexcept { return short_packets_; }
  std::uint64_t line_errors() const noexcept { return line_errors_; }

 private:
  TransportStatus request(std::uint8_t request, std::uint16_t value,
                          std::uint16_t index = 0) noexcept;

  BulkTransport& transport_;
  rt::Duration timeout_;
  std::array<std::uint8_t, BulkTransport::kMaxBulkBytes> buffer_{};
  std::uint64_t status_only_packets_ = 0;
  std::uint64_t short_packets_ = 0;
  std::uint64_t line_errors_ = 0;
};

}  // namespace forcegrid::driver::ftdi
