// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>

namespace forcegrid::firmware {

/// Frames on a serial line, as in RFC 1055 (SLIP): a frame ends in 0xC0; in it 0xDB 0xDC stands for
/// 0xC0 and 0xDB 0xDD for 0xDB.
/// Real-time: no allocation, lock or throw. Threads: one.
class FrameReader {
 public:
  static constexpr std::size_t kLargest = 256;

  /// Takes one byte of the line.
  /// @returns the frame that it ends, valid until the next byte; empty: none. Frames that are too
  ///          long or badly escaped are left out.
  std::span<const std::uint8_t> take(std::uint8_t byte) noexcept;

 private:
  std::array<std::uint8_t, kLargest> bytes_{};
  std::size_t size_ = 0;
  bool escaped_ = false;
  bool broken_ = false;  ///< until the next end
};

/// Bytes that wait for the line. A frame that does not fit is left out as a whole.
/// Real-time: no allocation, lock or throw. Threads: one.
class FrameWriter {
 public:
  /// @returns false if there was no room.
  bool put(std::span<const std::uint8_t> frame) noexcept;
  /// The next byte for the line, which stays until pop().
  std::optional<std::uint8_t> next() const noexcept {
    return first_ == end_ ? std::nullopt : std::optional(bytes_[first_]);
  }
  void pop() noexcept { ++first_; }

 private:
  std::array<std::uint8_t, 512> bytes_{};
  std::size_t first_ = 0, end_ = 0;
};

/// The CRC-32 of zlib, PNG and Ethernet.
std::uint32_t crc32(std::span<const std::uint8_t> bytes) noexcept;

/// Numbers in little-endian bytes, as the processor has them.
template <typename Value>
void put(std::span<std::uint8_t> bytes, std::size_t offset, const Value& value) noexcept {
  std::memcpy(bytes.data() + offset, &value, sizeof value);
}
template <typename Value>
Value get(std::span<const std::uint8_t> bytes, std::size_t offset) noexcept {
  Value value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

}  // namespace forcegrid::firmware
