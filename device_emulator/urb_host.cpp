// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/urb_host.h"

#include <algorithm>
#include <cassert>

#include "device_emulator/usbip_wire.h"

namespace forcegrid::emulator {

namespace {

constexpr std::size_t kOverfill_bytes = 64;

}  // namespace

std::vector<Urb>::iterator UrbHost::first(std::uint8_t endpoint_address) {
  return std::find_if(pending_.begin(), pending_.end(), [endpoint_address](const Urb& urb) {
    return urb.endpoint.address == endpoint_address;
  });
}

std::optional<std::span<const std::uint8_t>> UrbHost::out_packet(std::uint8_t endpoint_address) {
  const auto urb = first(endpoint_address);
  if (urb == pending_.end()) {
    return std::nullopt;
  }
  const auto rest = std::span<const std::uint8_t>(urb->data).subspan(urb->sent_bytes);
  return rest.first(std::min(rest.size(), urb->endpoint.packet_bytes));
}

void UrbHost::take_out(std::uint8_t endpoint_address) {
  const auto urb = first(endpoint_address);
  assert(urb != pending_.end());
  const std::size_t taken_bytes =
      std::min(urb->data.size() - urb->sent_bytes, urb->endpoint.packet_bytes);
  urb->sent_bytes += taken_bytes;
  if (urb->sent_bytes < urb->data.size()) {
    return;
  }
  if (urb->zero_packet && taken_bytes == urb->endpoint.packet_bytes) {
    return;
  }
  complete(urb, 0);
}

bool UrbHost::wants_in(std::uint8_t endpoint_address) {
  return first(endpoint_address) != pending_.end();
}

bool UrbHost::give_in(std::uint8_t endpoint_address, std::span<const std::uint8_t> packet) {
  const auto urb = first(endpoint_address);
  assert(urb != pending_.end() && packet.size() <= urb->endpoint.packet_bytes);
  if (packet.size() > urb->buffer_bytes - urb->data.size()) {
    complete(urb, usbip::kBabble);
    return false;
  }
  urb->data.insert(urb->data.end(), packet.begin(), packet.end());
  const bool full = urb->data.size() == urb->buffer_bytes;
  if (full || packet.size() < urb->endpoint.packet_bytes) {
    complete(urb, urb->short_is_error && !full ? usbip::kShortTransfer : 0);
  }
  return true;
}

void UrbHost::babble(std::uint8_t endpoint_address) {
  const auto urb = first(endpoint_address);
  assert(urb != pending_.end());
  complete(urb, usbip::kBabble);
}

void UrbHost::overfill(std::uint8_t endpoint_address) {
  const auto urb = first(endpoint_address);
  assert(urb != pending_.end());
  urb->data.resize(urb->buffer_bytes + kOverfill_bytes);
  complete(urb, 0);
}

void UrbHost::fail_all(std::uint8_t endpoint_address, std::int32_t status) {
  for (auto urb = first(endpoint_address); urb != pending_.end(); urb = first(endpoint_address)) {
    complete(urb, status);
  }
}

void UrbHost::complete(std::vector<Urb>::iterator urb, std::int32_t status) {
  if (urb->endpoint.in()) {
    usbip::append_submit_reply(replies_, urb->sequence, status,
                               static_cast<std::uint32_t>(urb->data.size()), urb->data);
  } else {
    usbip::append_submit_reply(replies_, urb->sequence, status,
                               static_cast<std::uint32_t>(urb->sent_bytes), {});
  }
  pending_.erase(urb);
}

}  // namespace forcegrid::emulator
