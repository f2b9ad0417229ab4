// SPDX-License-Identifier: Apache-2.0
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "link/forcegrid_link.h"
#include "link/wire.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

bool taken_by_c_header(std::span<const std::byte> datagram) {
  fg_link end;
  fg_link_init(&end, 2.0, nullptr);
  std::array<unsigned char, FG_SEAL_OVERHEAD_BYTES> reply;
  std::size_t reply_size = 0;
  const fg_event event = fg_link_take(&end, reinterpret_cast<const unsigned char*>(datagram.data()),
                                      datagram.size(), "servo", 5, 0, reply.data(), &reply_size);
  return event == FG_TOOL_STATE || event == FG_QUERY;
}

// Without a tool's number and in version 1 or 3, which the C header knows.
bool opens_a_session_of_the_only_tool(const link::Decoded& decoded) {
  return decoded.tool == 0 && decoded.content != link::Content::kSensitivities &&
         (std::holds_alternative<link::ToolState>(decoded.message) ||
          std::holds_alternative<link::Query>(decoded.message));
}

void check(std::span<const std::byte> datagram) {
  const link::Decoded decoded = link::decode(datagram);
  require(taken_by_c_header(datagram) == opens_a_session_of_the_only_tool(decoded),
          "the C header takes what the library takes");
  const bool empty = std::holds_alternative<std::monostate>(decoded.message);
  require((decoded.status == link::WireStatus::kOk) != empty, "a message only if it is sound");
  if (empty) {
    require(decoded.session_id == 0 && decoded.tool == 0, "no session without a message");
    return;
  }
  std::array<std::byte, link::kMaxDatagramBytes> again;
  const link::Encoded encoded = std::visit(
      [&](const auto& message) {
        if constexpr (std::is_same_v<std::decay_t<decltype(message)>, std::monostate>) {
          return link::Encoded{};
        } else {
          return link::encode(message, decoded.session_id, again, decoded.tool, decoded.content);
        }
      },
      decoded.message);
  require(encoded.status == link::WireStatus::kOk, "what is accepted can be sent");
  require(decoded.content == link::Content::kSensitivities ||
              datagram.size() <= link::kMaxOlderDatagramBytes,
          "older versions keep their bound");
  require(encoded.size_bytes == datagram.size() &&
              std::equal(datagram.begin(), datagram.end(), again.begin()),
          "a message has one form");
}

}  // namespace

void link_datagram(Input input) {
  check(std::as_bytes(input));
  // The same with length and checksum put right, so that what lies behind them is tried as well.
  if (input.size() < link::kHeaderBytes + link::kChecksumBytes) {
    return;
  }
  std::vector<std::byte> repaired(input.size());
  std::memcpy(repaired.data(), input.data(), input.size());
  const std::size_t body_bytes = input.size() - link::kChecksumBytes;
  const auto crc = static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef*>(repaired.data()), static_cast<uInt>(body_bytes)));
  for (std::size_t i = 0; i < link::kChecksumBytes; ++i) {
    repaired[body_bytes + i] = static_cast<std::byte>(crc >> (8 * i));
  }
  check(repaired);
}

}  // namespace forcegrid::fuzz
