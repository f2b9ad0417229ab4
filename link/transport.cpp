// SPDX-License-Identifier: Apache-2.0
#include "link/transport.h"

#include <cerrno>
#include <chrono>
#include <utility>

namespace forcegrid::link {
namespace {

/// Also the clock of the servo's cycles (CLOCK_MONOTONIC).
std::int64_t now_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::optional<SealedChannel> channel_with(LinkEnd own_end, std::vector<LinkKey> keys) {
  if (keys.empty()) {
    return std::nullopt;
  }
  return std::make_optional<SealedChannel>(own_end, std::move(keys));
}

}  // namespace

Transport::Transport(LinkEnd own_end, const Address& local, std::vector<LinkKey> keys)
    : own_end_(own_end), channel_(channel_with(own_end, std::move(keys))), socket_(local) {}

SendStatus Transport::send(const Address& to, const SealedPeer& peer, const Encoded& encoded,
                           std::span<const std::byte> buffer, LinkStatistics& statistics) noexcept {
  if (encoded.status != WireStatus::kOk) {
    ++statistics.send_invalid;
    return SendStatus::kInvalid;
  }
  std::span<const std::byte> datagram = buffer.first(encoded.size_bytes);
  std::array<std::byte, kMaxDatagramBytes> sealed;
  if (channel_) {
    datagram = std::span(sealed).first(channel_->seal(peer, datagram, now_ns(), sealed));
  }
  const int error = socket_.send_to(to, datagram);
  if (error == 0) {
    ++statistics.sent;
    return SendStatus::kSent;
  }
  if (error == ECONNREFUSED) {
    return SendStatus::kNoPeer;
  }
  ++statistics.send_failed;
  statistics.last_send_errno = error;
  return SendStatus::kSystemFailed;
}

std::optional<Transport::Incoming> Transport::open(const UdpSocket::Received& received,
                                                   std::span<std::byte> buffer,
                                                   LinkStatistics& statistics) noexcept {
  if (received.size_bytes > buffer.size()) {
    ++statistics.malformed[static_cast<std::size_t>(WireStatus::kBadLength)];
    return std::nullopt;
  }
  const std::span<std::byte> arrived = buffer.first(received.size_bytes);
  if (!channel_) {
    return Incoming{arrived, {}, {}};
  }
  const SealedChannel::Opened opened = channel_->open(arrived, now_ns());
  switch (opened.status) {
    case SealStatus::kOk:
      return Incoming{opened.inside, opened.peer, opened.times};
    case SealStatus::kHello:
      ++statistics.hellos;
      return Incoming{{}, opened.peer, opened.times};
    default:
      break;
  }
  ++statistics.seal_refused[static_cast<std::size_t>(opened.status)];
  // Only the end that listens replies, so that two ends never keep a stale datagram going round.
  if (opened.status == SealStatus::kStale && own_end_ == LinkEnd::kSimulator) {
    std::array<std::byte, kSealOverheadBytes> hello;
    const std::size_t size = channel_->seal(opened.peer, {}, now_ns(), hello);
    if (socket_.send_to(received.sender, std::span(hello).first(size)) != 0) {
      ++statistics.send_failed;
    }
  }
  return std::nullopt;
}

}  // namespace forcegrid::link
