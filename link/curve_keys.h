// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "link/key.h"

namespace forcegrid::link {

/// A Curve25519 key pair of one side of an authenticated channel (ZeroMQ's CURVE). Wiped on
/// destruction.
struct CurvePair {
  std::array<unsigned char, 32> public_key{};
  std::array<unsigned char, 32> secret_key{};

  CurvePair() = default;
  CurvePair(const CurvePair&) = delete;
  CurvePair& operator=(const CurvePair&) = delete;
  ~CurvePair();
};

enum class CurveSide : unsigned char { kServer, kClient };

/// Derives the pair of a side from the secret that both sides share, so that one key file is
/// enough:
///   secret key = BLAKE2b-256("forcegrid curve server" or "forcegrid curve client", keyed with the
///   secret), public key = X25519(secret key, base point)
/// Each side can derive the other's public key, and nobody without the key file can.
/// Real-time: no; set-up only. Threads: any.
void derive(const LinkKey& key, CurveSide side, CurvePair& pair);

/// Compares in a time that does not depend on where they differ.
bool same_public_key(const CurvePair& pair, const void* other, std::size_t size) noexcept;

}  // namespace forcegrid::link
