// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstddef>
#include <cstring>
#include <vector>

#include "link/sealed_channel.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

/// The secret of the worked examples, which the kept inputs are sealed with.
std::vector<link::LinkKey> worked_keys() {
  std::array<std::byte, link::kKeyBytes> secret{};
  for (std::size_t i = 0; i < secret.size(); ++i) {
    secret[i] = static_cast<std::byte>(i);
  }
  std::vector<link::LinkKey> keys;
  keys.emplace_back(secret);
  return keys;
}

}  // namespace

void sealed_datagram(Input input) {
  // Even with the key in a fuzzer's hands: it can't know the stream that an end has drawn.
  static link::SealedChannel servo(link::LinkEnd::kServo, worked_keys());
  static link::SealedChannel simulator(link::LinkEnd::kSimulator, worked_keys());
  for (link::SealedChannel* end : {&servo, &simulator}) {
    std::vector<std::byte> bytes(input.size());
    if (!input.empty()) {
      std::memcpy(bytes.data(), input.data(), input.size());
    }
    const link::SealedChannel::Opened opened = end->open(bytes, 1);
    require(opened.status != link::SealStatus::kOk && opened.status != link::SealStatus::kHello,
            "nothing is taken that was not made for this start of the program");
    require(opened.inside.empty(), "nothing is shown of what is not taken");
    if (opened.status == link::SealStatus::kStale) {
      std::array<std::byte, link::kSealOverheadBytes> hello;
      const std::size_t size = end->seal(opened.peer, {}, 1, hello);
      require(size > 0 && size <= input.size(), "a hello is no longer than what it answers");
    }
  }
}

}  // namespace forcegrid::fuzz
