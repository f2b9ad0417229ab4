// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "link/wire.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {

using Bytes = std::vector<std::byte>;

template <typename Message>
Bytes encoded(const Message& message, ToolId tool = 0, Content content = Content::kPosition,
              std::uint64_t session_id = worked::kSession) {
  Bytes buffer(kMaxDatagramBytes);
  const Encoded result = encode(message, session_id, buffer, tool, content);
  EXPECT_EQ(result.status, WireStatus::kOk) << to_string(result.status);
  buffer.resize(result.size_bytes);
  return buffer;
}

/// Puts a matching checksum under changed bytes, as a faulty or hostile peer would.
inline Bytes with_checksum(Bytes datagram) {
  const std::size_t body = datagram.size() - kChecksumBytes;
  const auto checksum =
      ::crc32(0, reinterpret_cast<const Bytef*>(datagram.data()), static_cast<uInt>(body));
  for (std::size_t i = 0; i < kChecksumBytes; ++i) {
    datagram[body + i] = static_cast<std::byte>((checksum >> (8 * i)) & 0xFF);
  }
  return datagram;
}

/// Overwrites the bytes at `offset` with the machine's (little-endian) ones of `value`.
template <typename T>
Bytes with(Bytes datagram, std::size_t offset, T value) {
  static_assert(std::endian::native == std::endian::little);
  const auto bytes = std::bit_cast<std::array<std::byte, sizeof(T)>>(value);
  std::copy(bytes.begin(), bytes.end(), datagram.begin() + static_cast<std::ptrdiff_t>(offset));
  return with_checksum(std::move(datagram));
}

/// What the reader says of such a datagram.
template <typename T>
WireStatus status_with(Bytes datagram, std::size_t offset, T value) {
  return decode(with(std::move(datagram), offset, value)).status;
}

}  // namespace forcegrid::link
