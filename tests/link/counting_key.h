// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "link/key.h"

namespace forcegrid::link {

/// A key for tests: bytes first, first + 1, ... first + 31.
inline LinkKey counting_key(int first = 0) {
  std::array<std::byte, kKeyBytes> secret{};
  for (std::size_t i = 0; i < kKeyBytes; ++i) {
    secret[i] = static_cast<std::byte>(first + static_cast<int>(i));
  }
  return LinkKey(secret);
}

template <typename... Firsts>
std::vector<LinkKey> counting_keys(Firsts... firsts) {
  std::vector<LinkKey> keys;
  (keys.push_back(counting_key(firsts)), ...);
  return keys;
}

}  // namespace forcegrid::link
