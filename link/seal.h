// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "link/key.h"
#include "link/wire.h"

/// The link's datagrams under a key, for a network that others can reach; docs/link_protocol.md has
/// every byte.
///
/// head (56 bytes, readable) | XChaCha20-Poly1305( times (24 bytes) | datagram of wire.h ) | tag
/// (16)
namespace forcegrid::link {

inline constexpr std::uint16_t kSealVersion = 1;
inline constexpr std::size_t kSealHeadBytes = 56;
inline constexpr std::size_t kSealTimesBytes = 24;
inline constexpr std::size_t kSealTagBytes = 16;
inline constexpr std::size_t kSealOverheadBytes = kSealHeadBytes + kSealTimesBytes + kSealTagBytes;
static_assert(kPoseForceSampleBytes + kSealOverheadBytes <= kMaxOlderDatagramBytes);
static_assert(kSurfacePatchBytes + kSealOverheadBytes <= kMaxOlderDatagramBytes);
static_assert(kSensitivitiesForceSampleBytes + kSealOverheadBytes <= kMaxDatagramBytes);

/// What became of a datagram that arrived, in the order in which it is checked.
enum class SealStatus : std::uint8_t {
  kOk,            ///< authentic, fresh and new: the datagram inside may be read
  kHello,         ///< the same with nothing inside: announces the peer's stream
  kTooShort,      ///< no room for head, times and tag
  kNotSealed,     ///< does not start with "FGRS", as a datagram of a link without a key
  kBadVersion,    ///< another version of the sealed form
  kBadDirection,  ///< made by an end like this one, or a reserved field is not zero
  kUnknownKey,    ///< sealed with a key that this end does not have
  kForged,        ///< the tag is wrong: forged, damaged or changed on its way
  kStale,         ///< authentic, but of an old session, or the peer has not yet heard this
                  ///< end's stream
  kReplayed,      ///< authentic, but this very datagram has been taken before
};
inline constexpr std::size_t kSealStatusCount = 10;

#pragma GCC visibility push(default)
/// Static text in lower case, e.g. "forged".
const char* to_string(SealStatus status) noexcept;
#pragma GCC visibility pop

/// A random number that one end draws when it starts: it names all that this end then sends and is
/// part of every nonce, so that no nonce is ever used twice, also across restarts.
using StreamId = std::array<std::byte, 16>;

/// Which end made a datagram.
enum class LinkEnd : std::uint8_t { kServo = 1, kSimulator = 2 };

/// The readable part; authenticated like the rest.
struct SealedHead {
  LinkEnd from = LinkEnd::kServo;
  KeyId key_id{};
  StreamId stream{};          ///< of the sender
  std::uint64_t counter = 0;  ///< of the stream's datagrams, from 1
  StreamId heard{};           ///< the receiver's stream if the sender has heard it; else zero
};

/// What lets each end estimate the other's clock.
struct SealedTimes {
  std::int64_t sent_ns = 0;            ///< by the sender's clock: now
  std::int64_t heard_sent_ns = 0;      ///< by the receiver's: when its newest one heard here left
  std::int64_t heard_received_ns = 0;  ///< by the sender's: when that one came
};

/// Reads the head of what claims to come from `from`. Safe for any bytes of any length.
/// @returns kOk, or what is wrong from kTooShort to kBadDirection.
/// Real-time: bounded, no allocation, lock or throw. Threads: any.
[[nodiscard]] SealStatus read_head(std::span<const std::byte> sealed, LinkEnd from,
                                   SealedHead& head) noexcept;

/// Authenticates a datagram whose head has been read, and decrypts it in place.
/// @returns the datagram inside (maybe empty), part of `sealed`; nothing if the tag is wrong, and
///   `times` is then unchanged.
/// Real-time: some us, no allocation, lock or throw. Threads: any.
[[nodiscard]] std::optional<std::span<const std::byte>> unseal(std::span<std::byte> sealed,
                                                               const LinkKey& key,
                                                               SealedTimes& times) noexcept;

/// Writes the sealed form of `datagram` (maybe empty) to the front of `buffer`. `head.stream` and
/// `head.counter` are the nonce: the caller never uses a pair twice with one key. `head.key_id` is
/// the key's.
/// @returns its size, 0 if `buffer` is too small.
/// Real-time: some us, no allocation, lock or throw. Threads: any.
[[nodiscard]] std::size_t seal(const SealedHead& head, const SealedTimes& times,
                               std::span<const std::byte> datagram, const LinkKey& key,
                               std::span<std::byte> buffer) noexcept;

}  // namespace forcegrid::link
