// SPDX-License-Identifier: Apache-2.0
#include "link/seal.h"

#include <sodium.h>

#include <algorithm>
#include <cstring>

namespace forcegrid::link {
namespace {

constexpr std::array<std::byte, 4> kSealMagic = {std::byte{'F'}, std::byte{'G'}, std::byte{'R'},
                                                 std::byte{'S'}};
constexpr std::size_t kVersionAt = 4;
constexpr std::size_t kDirectionAt = 6;
constexpr std::size_t kReservedAt = 7;
constexpr std::size_t kKeyIdAt = 8;
constexpr std::size_t kStreamAt = 16;
constexpr std::size_t kCounterAt = 32;
constexpr std::size_t kHeardAt = 40;
constexpr std::size_t kSentAt = kSealHeadBytes;
constexpr std::size_t kHeardSentAt = kSentAt + 8;
constexpr std::size_t kHeardReceivedAt = kSentAt + 16;
static_assert(kHeardAt + sizeof(StreamId) == kSealHeadBytes);
static_assert(kHeardAt - kStreamAt == crypto_aead_xchacha20poly1305_ietf_NPUBBYTES,
              "stream and counter are the nonce");
static_assert(kSealTagBytes == crypto_aead_xchacha20poly1305_ietf_ABYTES);

unsigned char* bytes_at(std::span<std::byte> buffer, std::size_t at) noexcept {
  return reinterpret_cast<unsigned char*>(buffer.data() + at);
}

void put(std::span<std::byte> buffer, std::size_t at, std::uint64_t value,
         std::size_t size = sizeof(std::uint64_t)) noexcept {
  for (std::size_t i = 0; i < size; ++i) {
    buffer[at + i] = static_cast<std::byte>(value >> (8U * i));
  }
}

std::uint64_t get(std::span<const std::byte> buffer, std::size_t at,
                  std::size_t size = sizeof(std::uint64_t)) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < size; ++i) {
    value |= std::to_integer<std::uint64_t>(buffer[at + i]) << (8U * i);
  }
  return value;
}

}  // namespace

const char* to_string(SealStatus status) noexcept {
  switch (status) {
    case SealStatus::kOk:
      return "ok";
    case SealStatus::kHello:
      return "hello";
    case SealStatus::kTooShort:
      return "too short";
    case SealStatus::kNotSealed:
      return "not sealed";
    case SealStatus::kBadVersion:
      return "bad version";
    case SealStatus::kBadDirection:
      return "bad direction";
    case SealStatus::kUnknownKey:
      return "unknown key";
    case SealStatus::kForged:
      return "forged";
    case SealStatus::kStale:
      return "stale";
    case SealStatus::kReplayed:
      return "replayed";
  }
  return "unknown seal status";
}

SealStatus read_head(std::span<const std::byte> sealed, LinkEnd from, SealedHead& head) noexcept {
  if (sealed.size() < kSealMagic.size()) {
    return SealStatus::kTooShort;
  }
  if (!std::equal(kSealMagic.begin(), kSealMagic.end(), sealed.begin())) {
    return SealStatus::kNotSealed;
  }
  if (sealed.size() < kSealOverheadBytes) {
    return SealStatus::kTooShort;
  }
  if (get(sealed, kVersionAt, 2) != kSealVersion) {
    return SealStatus::kBadVersion;
  }
  if (get(sealed, kDirectionAt, 1) != static_cast<std::uint64_t>(from) ||
      get(sealed, kReservedAt, 1) != 0) {
    return SealStatus::kBadDirection;
  }
  head.from = from;
  std::memcpy(head.key_id.data(), sealed.data() + kKeyIdAt, sizeof head.key_id);
  std::memcpy(head.stream.data(), sealed.data() + kStreamAt, sizeof head.stream);
  head.counter = get(sealed, kCounterAt);
  std::memcpy(head.heard.data(), sealed.data() + kHeardAt, sizeof head.heard);
  return SealStatus::kOk;
}

std::optional<std::span<const std::byte>> unseal(std::span<std::byte> sealed, const LinkKey& key,
                                                 SealedTimes& times) noexcept {
  if (sealed.size() < kSealOverheadBytes) {
    return std::nullopt;
  }
  unsigned char* secret_part = bytes_at(sealed, kSealHeadBytes);
  if (::crypto_aead_xchacha20poly1305_ietf_decrypt(
          secret_part, nullptr, nullptr, secret_part, sealed.size() - kSealHeadBytes,
          bytes_at(sealed, 0), kSealHeadBytes, bytes_at(sealed, kStreamAt), key.secret()) != 0) {
    return std::nullopt;
  }
  times.sent_ns = static_cast<std::int64_t>(get(sealed, kSentAt));
  times.heard_sent_ns = static_cast<std::int64_t>(get(sealed, kHeardSentAt));
  times.heard_received_ns = static_cast<std::int64_t>(get(sealed, kHeardReceivedAt));
  return sealed.subspan(kSealHeadBytes + kSealTimesBytes, sealed.size() - kSealOverheadBytes);
}

std::size_t seal(const SealedHead& head, const SealedTimes& times,
                 std::span<const std::byte> datagram, const LinkKey& key,
                 std::span<std::byte> buffer) noexcept {
  const std::size_t size = datagram.size() + kSealOverheadBytes;
  if (buffer.size() < size) {
    return 0;
  }
  std::copy(kSealMagic.begin(), kSealMagic.end(), buffer.begin());
  put(buffer, kVersionAt, kSealVersion, 2);
  put(buffer, kDirectionAt, static_cast<std::uint64_t>(head.from), 1);
  put(buffer, kReservedAt, 0, 1);
  std::memcpy(buffer.data() + kKeyIdAt, head.key_id.data(), sizeof head.key_id);
  std::memcpy(buffer.data() + kStreamAt, head.stream.data(), sizeof head.stream);
  put(buffer, kCounterAt, head.counter);
  std::memcpy(buffer.data() + kHeardAt, head.heard.data(), sizeof head.heard);
  put(buffer, kSentAt, static_cast<std::uint64_t>(times.sent_ns));
  put(buffer, kHeardSentAt, static_cast<std::uint64_t>(times.heard_sent_ns));
  put(buffer, kHeardReceivedAt, static_cast<std::uint64_t>(times.heard_received_ns));
  std::copy(datagram.begin(), datagram.end(), buffer.begin() + kSealHeadBytes + kSealTimesBytes);
  unsigned char* secret_part = bytes_at(buffer, kSealHeadBytes);
  ::crypto_aead_xchacha20poly1305_ietf_encrypt(
      secret_part, nullptr, secret_part, kSealTimesBytes + datagram.size(), bytes_at(buffer, 0),
      kSealHeadBytes, nullptr, bytes_at(buffer, kStreamAt), key.secret());
  return size;
}

}  // namespace forcegrid::link
