// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/ft232r.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::emulator {

namespace {

constexpr double kBaseClock_Hz = 3e6;  // 48 MHz / 16
// Modem status: bit 0 is always set; CTS, DSR, RI and DCD are not connected and read inactive.
constexpr std::uint8_t kModemStatusByte = 0x01;
constexpr std::uint8_t kLineOverrun = 0x02;
constexpr std::uint8_t kLineFraming = 0x08;
constexpr std::uint8_t kLineTransmitHoldingEmpty = 0x20;
constexpr std::uint8_t kLineTransmitEmpty = 0x40;

}  // namespace

rt::Duration LineSettings::character_time() const noexcept {
  // Start bit, data, parity, and 1, 1.5 or 2 stop bits.
  const double stop = stop_bits == 0 ? 1.0 : (stop_bits == 1 ? 1.5 : 2.0);
  return rt::from_seconds((1.0 + data_bits + (parity != 0 ? 1.0 : 0.0) + stop) / baud_Hz);
}

std::optional<double> Ft232r::baud_of_divisor(std::uint32_t divisor) noexcept {
  constexpr std::array<double, 8> kFraction = {0.0, 0.5, 0.25, 0.125, 0.375, 0.625, 0.75, 0.875};
  const double value = (divisor & 0x3FFFU) + kFraction[(divisor >> 14) & 7U];
  if (value == 0.0) {
    return kBaseClock_Hz;
  }
  if (value == 1.0) {
    return kBaseClock_Hz / 1.5;
  }
  if (value < 2.0) {
    return std::nullopt;
  }
  return kBaseClock_Hz / value;
}

void Ft232r::reset(SerialPeer& peer, rt::TimePoint time) noexcept {
  purge_transmit();
  purge_receive();
  flow_ = FlowControl::kNone;
  event_.reset();
  set_modem_lines(false, false, peer, time);
}

void Ft232r::purge_receive() noexcept {
  receive_.clear();
  event_seen_ = false;
}

void Ft232r::set_modem_lines(std::optional<bool> dtr, std::optional<bool> rts, SerialPeer& peer,
                             rt::TimePoint time) noexcept {
  const bool changed = dtr.value_or(line_.dtr) != line_.dtr || rts.value_or(line_.rts) != line_.rts;
  line_.dtr = dtr.value_or(line_.dtr);
  line_.rts = rts.value_or(line_.rts);
  if (changed) {
    peer.modem_lines_changed(line_, time);
  }
}

void Ft232r::set_format(std::uint8_t data_bits, std::uint8_t parity, std::uint8_t stop_bits,
                        bool break_on) noexcept {
  line_.data_bits = data_bits;
  line_.parity = parity;
  line_.stop_bits = stop_bits;
  break_on_ = break_on;
}

bool Ft232r::transmitter_held() const noexcept {
  // CTS and DSR are inactive, and nobody sends XOFF.
  return break_on_ || flow_ == FlowControl::kRtsCts || flow_ == FlowControl::kDtrDsr;
}

std::array<std::uint8_t, Ft232r::kStatusBytes> Ft232r::status() const noexcept {
  std::uint8_t line = 0;
  if (transmit_.size() <= 1) {
    line |= kLineTransmitHoldingEmpty;  // the oldest character is in the shift register
  }
  if (transmit_.empty()) {
    line |= kLineTransmitEmpty;
  }
  if (overrun_) {
    line |= kLineOverrun;
  }
  if (framing_error_) {
    line |= kLineFraming;
  }
  return {kModemStatusByte, line};
}

bool Ft232r::offer_out(std::span<const std::uint8_t> packet, rt::TimePoint now) noexcept {
  if (bit_mode_ != 0) {
    return true;  // goes to pins without a connection
  }
  if (packet.size() > transmit_.room()) {
    return false;
  }
  if (transmit_.empty()) {
    transmit_start_ = std::max(transmit_start_, now);
  }
  for (const std::uint8_t byte : packet) {
    transmit_.push(byte);
  }
  return true;
}

void Ft232r::advance_to(rt::TimePoint now, SerialPeer& peer) noexcept {
  while (!transmit_.empty() && !transmitter_held()) {
    const rt::TimePoint end = transmit_start_ + line_.character_time();
    if (end > now) {
      break;
    }
    const std::uint8_t character = transmit_.pop();
    transmit_start_ = end;
    peer.receive(character, line_, end);
  }
  if (transmitter_held()) {
    transmit_start_ = std::max(transmit_start_, now);
  }
  receive_until(now);
}

void Ft232r::send_from_peer(std::span<const std::uint8_t> characters, double baud_Hz,
                            rt::TimePoint start) noexcept {
  LineSettings peer_line;
  peer_line.baud_Hz = baud_Hz;
  peer_line_free_ = std::max(peer_line_free_, start) +
                    static_cast<rt::Duration::rep>(characters.size()) * peer_line.character_time();
  const bool readable = line_.is_8n1() && std::abs(line_.baud_Hz / baud_Hz - 1.0) <= kBaudTolerance;
  for (const std::uint8_t character : characters) {
    if (!readable) {
      ++statistics_.framing_errors;
      framing_error_ = true;
    } else if (arriving_.room() == 0) {
      ++statistics_.overruns;
      overrun_ = true;
    } else if (bit_mode_ == 0) {
      arriving_.push({character, peer_line_free_});
    }
  }
}

void Ft232r::receive_until(rt::TimePoint now) noexcept {
  while (!arriving_.empty() && arriving_[0].time <= now) {
    const Arrival arrival = arriving_.pop();
    if (receive_.room() == 0) {
      ++statistics_.overruns;
      overrun_ = true;
      continue;
    }
    receive_.push(arrival.character);
    event_seen_ = event_seen_ || event_ == arrival.character;
  }
}

void Ft232r::set_asked(bool asked, rt::TimePoint now) noexcept {
  if (!asked) {
    asked_since_.reset();
  } else if (!asked_since_) {
    asked_since_ = now;
  }
}

std::optional<Ft232r::Packet> Ft232r::in_packet(rt::TimePoint now) const noexcept {
  constexpr std::size_t kMostData = kPacketBytes - kStatusBytes;
  const bool data_due = !receive_.empty() && (receive_.size() >= kMostData || event_seen_ ||
                                              now - last_packet_ >= latency());
  const bool status_due = asked_since_ && now - *asked_since_ >= latency();
  if (!data_due && !status_due) {
    return std::nullopt;
  }
  Packet packet;
  const auto head = status();
  std::copy(head.begin(), head.end(), packet.bytes.begin());
  packet.size = kStatusBytes + std::min(receive_.size(), kMostData);
  for (std::size_t i = kStatusBytes; i < packet.size; ++i) {
    packet.bytes[i] = receive_[i - kStatusBytes];
  }
  return packet;
}

void Ft232r::in_taken(rt::TimePoint now) noexcept {
  const std::size_t taken = std::min(receive_.size(), kPacketBytes - kStatusBytes);
  for (std::size_t i = 0; i < taken; ++i) {
    (void)receive_.pop();
  }
  event_seen_ = event_seen_ && !receive_.empty();
  overrun_ = false;
  framing_error_ = false;
  last_packet_ = now;
  asked_since_.reset();
}

std::optional<rt::TimePoint> Ft232r::wake_time() const noexcept {
  std::optional<rt::TimePoint> wake;
  const auto at = [&wake](rt::TimePoint time) { wake = wake ? std::min(*wake, time) : time; };
  if (!transmit_.empty() && !transmitter_held()) {
    at(transmit_start_ + static_cast<rt::Duration::rep>(transmit_.size()) * line_.character_time());
  }
  if (asked_since_) {
    at(*asked_since_ + latency());
    if (!receive_.empty()) {
      at(last_packet_ + latency());
    }
    if (!arriving_.empty()) {
      at(arriving_[arriving_.size() - 1].time);
    }
  }
  return wake;
}

}  // namespace forcegrid::emulator
