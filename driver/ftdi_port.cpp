// SPDX-License-Identifier: Apache-2.0
#include "driver/ftdi_port.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace forcegrid::driver::ftdi {
namespace {

constexpr std::uint8_t kVendorOut = 0x40;
constexpr std::uint8_t kReset = 0x00;
constexpr std::uint8_t kModemControl = 0x01;
constexpr std::uint8_t kFlowControl = 0x02;
constexpr std::uint8_t kBaudRate = 0x03;
constexpr std::uint8_t kData = 0x04;
constexpr std::uint8_t kLatencyTimer = 0x09;

constexpr std::uint16_t kPurgeReceive = 1;
constexpr std::uint16_t kPurgeTransmit = 2;
// High byte: which lines change; low byte: their new levels.
constexpr std::uint16_t kDtr = 0x0100;
constexpr std::uint16_t kRts = 0x0200;
constexpr std::uint16_t k8N1 = 0x0008;

constexpr std::size_t kStatusBytes = 2;
constexpr std::uint8_t kLineErrorBits = 0x1E;
// Packets that the host may hold from before a purge: the transport's queue and what is on its way.
constexpr int kMaxStalePackets = 64;

// Code of 0, 1/8, ... 7/8.
constexpr std::array<std::uint8_t, 8> kEighths = {0, 3, 2, 4, 1, 5, 6, 7};

}  // namespace

Divisor encode_divisor(double divisor) noexcept {
  const auto eighths =
      static_cast<unsigned>(std::lround(8.0 * std::clamp(divisor, 1.0, 16383.875)));
  if (eighths < 14) {  // nearer to 1 or 1.5 than to 2
    return {.value = static_cast<std::uint16_t>(eighths < 10 ? 0 : 1)};
  }
  if (eighths < 16) {
    return {.value = 2};
  }
  const unsigned code = kEighths[eighths % 8];
  return {.value = static_cast<std::uint16_t>((eighths / 8) | ((code & 3) << 14)),
          .index = static_cast<std::uint16_t>(code >> 2)};
}

Stripped strip_status(std::span<std::uint8_t> transfer, std::size_t packet_bytes) noexcept {
  Stripped result;
  for (std::size_t at = 0; at < transfer.size(); at += packet_bytes) {
    const std::size_t size = std::min(packet_bytes, transfer.size() - at);
    if (size < kStatusBytes) {
      result.whole = false;
      break;
    }
    result.line_errors =
        static_cast<std::uint8_t>(result.line_errors | (transfer[at + 1] & kLineErrorBits));
    std::memmove(transfer.data() + result.bytes, transfer.data() + at + kStatusBytes,
                 size - kStatusBytes);
    result.bytes += size - kStatusBytes;
  }
  result.whole = result.whole && !transfer.empty();
  return result;
}

TransportStatus FtdiPort::request(std::uint8_t request, std::uint16_t value,
                                  std::uint16_t index) noexcept {
  return transport_.control_out(
      {.request_type = kVendorOut, .request = request, .value = value, .index = index}, timeout_);
}

TransportStatus FtdiPort::purge() noexcept {
  for (const std::uint16_t fifo : {kPurgeReceive, kPurgeTransmit}) {
    if (const TransportStatus status = request(kReset, fifo); status != TransportStatus::kOk) {
      return status;
    }
  }
  for (int i = 0; i < kMaxStalePackets; ++i) {
    const ReadResult stale = transport_.read(buffer_, rt::Duration::zero());
    if (stale.status == TransportStatus::kTimeout) {
      break;
    }
    if (stale.status != TransportStatus::kOk) {
      return stale.status;
    }
  }
  return TransportStatus::kOk;
}

TransportStatus FtdiPort::set_dtr(bool high) noexcept {
  return request(kModemControl, static_cast<std::uint16_t>(kDtr | (high ? 0x01 : 0)));
}

TransportStatus FtdiPort::set_rts(bool high) noexcept {
  return request(kModemControl, static_cast<std::uint16_t>(kRts | (high ? 0x02 : 0)));
}

TransportStatus FtdiPort::set_no_flow_control() noexcept { return request(kFlowControl, 0); }

TransportStatus FtdiPort::set_8n1() noexcept { return request(kData, k8N1); }

TransportStatus FtdiPort::set_divisor(double divisor) noexcept {
  const Divisor code = encode_divisor(divisor);
  return request(kBaudRate, code.value, code.index);
}

TransportStatus FtdiPort::set_latency(std::chrono::milliseconds latency) noexcept {
  return request(kLatencyTimer,
                 static_cast<std::uint16_t>(std::clamp<long>(latency.count(), 1, 255)));
}

FtdiPort::Read FtdiPort::read(rt::Duration timeout) noexcept {
  const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
  for (;;) {
    const ReadResult result = transport_.read(buffer_, deadline - rt::Clock::now());
    if (result.status != TransportStatus::kOk) {
      return {.status = result.status};
    }
    const Stripped stripped =
        strip_status({buffer_.data(), std::min(result.bytes, buffer_.size())}, buffer_.size());
    short_packets_ += stripped.whole ? 0 : 1;
    line_errors_ += stripped.line_errors != 0 ? 1 : 0;
    if (stripped.bytes > 0) {
      return {.status = TransportStatus::kOk,
              .data = {buffer_.data(), stripped.bytes},
              .arrived = result.arrived};
    }
    status_only_packets_ += stripped.whole ? 1 : 0;
    if (rt::Clock::now() >= deadline) {
      return {.status = TransportStatus::kTimeout};
    }
  }
}

}  // namespace forcegrid::driver::ftdi
