// SPDX-License-Identifier: Apache-2.0
#include "link/curve_keys.h"

#include <sodium.h>

#include <string_view>

namespace forcegrid::link {

CurvePair::~CurvePair() { ::sodium_memzero(secret_key.data(), secret_key.size()); }

void derive(const LinkKey& key, CurveSide side, CurvePair& pair) {
  const std::string_view purpose =
      side == CurveSide::kServer ? "forcegrid curve server" : "forcegrid curve client";
  ::crypto_generichash(pair.secret_key.data(), pair.secret_key.size(),
                       reinterpret_cast<const unsigned char*>(purpose.data()), purpose.size(),
                       key.secret(), kKeyBytes);
  ::crypto_scalarmult_curve25519_base(pair.public_key.data(), pair.secret_key.data());
}

bool same_public_key(const CurvePair& pair, const void* other, std::size_t size) noexcept {
  return size == pair.public_key.size() &&
         ::sodium_memcmp(pair.public_key.data(), other, size) == 0;
}

}  // namespace forcegrid::link
