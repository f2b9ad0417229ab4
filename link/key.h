// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "link/address.h"

namespace forcegrid::link {
#pragma GCC visibility push(default)

inline constexpr std::size_t kKeyBytes = 32;
/// Names the key that a datagram is sealed with, and reveals nothing about the key itself.
using KeyId = std::array<std::byte, 8>;

/// Sixteen hexadecimal digits. Real-time: no (allocates). Threads: any.
std::string to_string(const KeyId& id);

/// The secret that two ends of a link share. Its memory is locked where the system permits, has
/// guard pages, is left out of core dumps, and is wiped on destruction.
///
/// A key file is one line of text, `forcegrid-link-key-1 ID SECRET`: the id as 16 hexadecimal
/// digits, the secret as 64.
///   id = first 8 bytes of BLAKE2b-128("forcegrid link key id", keyed with the secret)
///
/// Real-time: no; set-up only. Threads: const members any.
class LinkKey {
 public:
  /// @throws LinkError naming the file and the remedy if it can't be read, is not a regular file,
  ///   is open to anyone but its owner (mode beyond 0600), belongs to a user other than this one or
  ///   root, or does not hold a key whose id is right.
  static LinkKey load(const std::string& file);

  /// Draws a new key from the system's random source and writes it to a file that does not exist
  /// yet, with mode 0600.
  /// @returns the key's id
  /// @throws LinkError naming the file and the remedy if it exists or can't be written.
  static KeyId generate(const std::string& file);

  /// For a secret that comes from elsewhere; the caller wipes its own copy.
  /// @throws LinkError when libsodium can't start or memory is short.
  explicit LinkKey(const std::array<std::byte, kKeyBytes>& secret);

  [[nodiscard]] const KeyId& id() const noexcept { return id_; }
  /// kKeyBytes of it.
  [[nodiscard]] const unsigned char* secret() const noexcept { return secret_.get(); }

 private:
  struct Wipe {
    void operator()(unsigned char* secret) const noexcept;
  };
  using Secret = std::unique_ptr<unsigned char[], Wipe>;

  static Secret reserve();
  explicit LinkKey(Secret secret);

  Secret secret_;
  KeyId id_{};
};

/// The keys of all files, in their order.
/// @throws LinkError as LinkKey::load().
std::vector<LinkKey> load_keys(const std::vector<std::string>& files);

#pragma GCC visibility pop
}  // namespace forcegrid::link
