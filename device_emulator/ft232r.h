// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "device_emulator/fixed_queue.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// How a UART is set.
struct LineSettings {
  double baud_Hz = 9600.0;
  std::uint8_t data_bits = 8;
  std::uint8_t parity = 0;     ///< 0: none
  std::uint8_t stop_bits = 0;  ///< 0: one
  bool dtr = false;
  bool rts = false;

  [[nodiscard]] bool is_8n1() const noexcept {
    return data_bits == 8 && parity == 0 && stop_bits == 0;
  }
  /// Time of one character on the line.
  [[nodiscard]] rt::Duration character_time() const noexcept;
};

/// What is connected to the UART of an Ft232r.
/// Real-time: implementations neither allocate, lock nor throw.
class SerialPeer {
 public:
  virtual ~SerialPeer() = default;
  /// Receives a character whose last bit came in at `time`.
  virtual void receive(std::uint8_t character, const LineSettings& line,
                       rt::TimePoint time) noexcept = 0;
  /// DTR or RTS has changed at `time`; `line` has the new state.
  virtual void modem_lines_changed(const LineSettings& line, rt::TimePoint time) noexcept = 0;
};

/// Bridge of an FT232R between its two bulk endpoints and its UART: FIFOs, serial timing, latency
/// timer, status bytes, and the state that vendor requests set.
///
/// Host to UART: OUT packets go into a FIFO of 128 bytes and leave it at the speed of the line; a
/// packet that does not fit is answered NAK. UART to host: a FIFO of 256 bytes; every IN packet is
/// two status bytes and up to 62 bytes of data. An IN token gets
///   - a packet with data when 62 bytes wait, when the event character has come in, or when any
///     data wait and the latency time has passed since the last packet;
///   - a bare status packet when nothing has come in for the latency time since the host began to
///     ask.
/// The chip's timer runs freely, and its manufacturer does not say from when. Here it starts when
/// the host begins to ask. So a bare packet never overtakes the answer to what the host has just
/// sent; clients of the real device rely on that. What the peer sends in one piece becomes visible
/// in one piece, with its last character.
///
/// Source: FTDI protocol notes in Linux `drivers/usb/serial/ftdi_sio.h`; jonas-schievink
/// ftdi-protocol; by way of the device's fact sheet.
/// Real-time: no allocation, lock or throw. Threads: one. Times must not decrease.
class Ft232r {
 public:
  static constexpr std::size_t kPacketBytes = 64;
  static constexpr std::size_t kStatusBytes = 2;
  static constexpr std::size_t kTransmitFifoBytes = 128;  ///< host to UART; FTDI calls it RX
  static constexpr std::size_t kReceiveFifoBytes = 256;   ///< UART to host; FTDI calls it TX
  static constexpr std::uint8_t kDefaultLatency_ms = 16;
  /// By how much two UARTs may differ. It admits both divisors, 2 and 2.125, that hosts compute for
  /// the device's 1 456 312 Bd, and all three, 21, 21.375 and 21.5, for its 140 000 Bd.
  static constexpr double kBaudTolerance = 0.031;

  enum class FlowControl : std::uint8_t { kNone = 0, kRtsCts = 1, kDtrDsr = 2, kXonXoff = 4 };

  struct Statistics {
    std::uint64_t overruns = 0;        ///< characters lost because the receive FIFO was full
    std::uint64_t framing_errors = 0;  ///< characters that came in at another speed than is set
  };

  /// An IN packet.
  struct Packet {
    std::array<std::uint8_t, kPacketBytes> bytes{};
    std::size_t size = 0;
    [[nodiscard]] std::span<const std::uint8_t> data() const noexcept {
      return std::span(bytes).first(size);
    }
  };

  /// Baud rate of a divisor: 3 MHz / (integer + fraction), integer in bits 0 to 13 and a code for
  /// the eighths in bits 14 to 16; 0 and 1 mean 3 and 2 MBd.
  /// @returns nothing for divisors in between, which the chip does not have.
  [[nodiscard]] static std::optional<double> baud_of_divisor(std::uint32_t divisor) noexcept;

  // What vendor requests do. The line's changes reach the peer at `time`.
  void reset(SerialPeer& peer, rt::TimePoint time) noexcept;
  void purge_transmit() noexcept { transmit_.clear(); }
  void purge_receive() noexcept;
  void set_modem_lines(std::optional<bool> dtr, std::optional<bool> rts, SerialPeer& peer,
                       rt::TimePoint time) noexcept;
  void set_flow_control(FlowControl flow) noexcept { flow_ = flow; }
  void set_baud(double baud_Hz) noexcept { line_.baud_Hz = baud_Hz; }
  void set_format(std::uint8_t data_bits, std::uint8_t parity, std::uint8_t stop_bits,
                  bool break_on) noexcept;
  void set_event_character(std::optional<std::uint8_t> character) noexcept { event_ = character; }
  void set_latency_ms(std::uint8_t latency_ms) noexcept { latency_ms_ = latency_ms; }
  /// Any mode but 0 disconnects the pins from the UART.
  void set_bit_mode(std::uint8_t mode) noexcept { bit_mode_ = mode; }

  [[nodiscard]] const LineSettings& line() const noexcept { return line_; }
  [[nodiscard]] std::uint8_t latency_ms() const noexcept { return latency_ms_; }
  /// Modem status and line status as the two bytes before all data.
  [[nodiscard]] std::array<std::uint8_t, kStatusBytes> status() const noexcept;

  /// The host sends an OUT packet. @returns false for NAK: it does not fit.
  [[nodiscard]] bool offer_out(std::span<const std::uint8_t> packet, rt::TimePoint now) noexcept;

  /// Says whether the host asks the IN endpoint at `now`; call it whenever that may have changed.
  void set_asked(bool asked, rt::TimePoint now) noexcept;
  /// The packet for an IN token at `now`; nothing for NAK. It stays until in_taken().
  [[nodiscard]] std::optional<Packet> in_packet(rt::TimePoint now) const noexcept;
  /// The host has taken in_packet(now).
  void in_taken(rt::TimePoint now) noexcept;

  /// Runs the line until `now`: the peer gets each character at its own time.
  void advance_to(rt::TimePoint now, SerialPeer& peer) noexcept;
  /// The peer sends characters from `start` on, back to back, at `baud_Hz`.
  void send_from_peer(std::span<const std::uint8_t> characters, double baud_Hz,
                      rt::TimePoint start) noexcept;

  /// When advance_to() or in_packet() next has something to do; nothing while only the host can
  /// change that.
  [[nodiscard]] std::optional<rt::TimePoint> wake_time() const noexcept;

  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  struct Arrival {
    std::uint8_t character = 0;
    rt::TimePoint time{};
  };

  [[nodiscard]] rt::Duration latency() const noexcept {
    return std::chrono::milliseconds(latency_ms_);
  }
  [[nodiscard]] bool transmitter_held() const noexcept;
  void receive_until(rt::TimePoint now) noexcept;

  LineSettings line_;
  FlowControl flow_ = FlowControl::kNone;
  bool break_on_ = false;
  std::uint8_t bit_mode_ = 0;
  std::uint8_t latency_ms_ = kDefaultLatency_ms;
  std::optional<std::uint8_t> event_;

  FixedQueue<std::uint8_t, kTransmitFifoBytes> transmit_;
  rt::TimePoint transmit_start_{};  // of the oldest character in transmit_
  FixedQueue<Arrival, 2 * kReceiveFifoBytes> arriving_;
  rt::TimePoint peer_line_free_{};
  FixedQueue<std::uint8_t, kReceiveFifoBytes> receive_;
  bool event_seen_ = false;
  bool overrun_ = false;  // since the last packet, as are the framing errors
  bool framing_error_ = false;

  std::optional<rt::TimePoint> asked_since_;
  rt::TimePoint last_packet_{};
  Statistics statistics_;
};

}  // namespace forcegrid::emulator
