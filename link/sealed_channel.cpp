// SPDX-License-Identifier: Apache-2.0
#include "link/sealed_channel.h"

#include <sodium.h>

#include <algorithm>
#include <string>
#include <utility>

namespace forcegrid::link {

SealedChannel::SealedChannel(LinkEnd own_end, std::vector<LinkKey> keys)
    : own_end_(own_end), keys_(std::move(keys)) {
  if (keys_.empty() || keys_.size() > kMaxKeys) {
    throw LinkError("link key: " + std::to_string(keys_.size()) + " keys given; give 1 to " +
                    std::to_string(kMaxKeys));
  }
  for (auto key = keys_.begin(); key != keys_.end(); ++key) {
    if (std::any_of(keys_.begin(), key,
                    [&](const LinkKey& other) { return other.id() == key->id(); })) {
      throw LinkError("link key: " + to_string(key->id()) + " is given twice; leave one out");
    }
  }
  begin_stream();
}

void SealedChannel::begin_stream() noexcept {
  ::randombytes_buf(own_stream_.data(), own_stream_.size());
  counter_ = 0;
  peer_count_ = 0;
}

SealStatus SealedChannel::admit(const StreamId& stream, std::uint64_t counter) noexcept {
  const auto known_end = peers_.begin() + static_cast<std::ptrdiff_t>(peer_count_);
  const auto known = std::find_if(peers_.begin(), known_end,
                                  [&](const PeerStream& peer) { return peer.id == stream; });
  if (known != known_end) {
    if (own_end_ == LinkEnd::kServo && known + 1 != known_end) {
      return SealStatus::kStale;
    }
    return known->window.pass(counter) ? SealStatus::kOk : SealStatus::kReplayed;
  }
  if (peer_count_ == kPeerStreams) {
    begin_stream();
    return SealStatus::kStale;
  }
  peers_[peer_count_] = {stream, ReplayWindow{}};
  return peers_[peer_count_++].window.pass(counter) ? SealStatus::kOk : SealStatus::kReplayed;
}

SealedChannel::Opened SealedChannel::open(std::span<std::byte> sealed,
                                          std::int64_t now_ns) noexcept {
  Opened opened;
  SealedHead head;
  opened.status =
      read_head(sealed, own_end_ == LinkEnd::kServo ? LinkEnd::kSimulator : LinkEnd::kServo, head);
  if (opened.status != SealStatus::kOk) {
    return opened;
  }
  const auto key =
      std::ranges::find_if(keys_, [&](const LinkKey& own) { return own.id() == head.key_id; });
  if (key == keys_.end()) {
    opened.status = SealStatus::kUnknownKey;
    return opened;
  }
  SealedTimes times;
  const auto inside = unseal(sealed, *key, times);
  if (!inside) {
    opened.status = SealStatus::kForged;
    return opened;
  }
  opened.peer = {head.stream, static_cast<std::uint8_t>(key - keys_.begin()), times.sent_ns,
                 now_ns};
  opened.status = head.heard == own_stream_ ? admit(head.stream, head.counter) : SealStatus::kStale;
  if (opened.status == SealStatus::kOk) {
    opened.inside = *inside;
    opened.times = {times.heard_sent_ns, times.heard_received_ns, times.sent_ns, now_ns};
    if (inside->empty()) {
      opened.status = SealStatus::kHello;
    }
  }
  return opened;
}

std::size_t SealedChannel::seal(const SealedPeer& peer, std::span<const std::byte> datagram,
                                std::int64_t now_ns, std::span<std::byte> buffer) noexcept {
  const LinkKey& key = keys_[peer.key_index];
  const SealedHead head = {own_end_, key.id(), own_stream_, ++counter_, peer.stream};
  return link::seal(head, {now_ns, peer.sent_ns, peer.received_ns}, datagram, key, buffer);
}

}  // namespace forcegrid::link
