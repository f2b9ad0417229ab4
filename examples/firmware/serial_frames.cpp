// SPDX-License-Identifier: Apache-2.0
#include "examples/firmware/serial_frames.h"

#include <bit>

namespace forcegrid::firmware {
namespace {

static_assert(std::endian::native == std::endian::little);  // as the frames' numbers are

constexpr std::uint8_t kEnd = 0xC0, kEscape = 0xDB, kEscapedEnd = 0xDC, kEscapedEscape = 0xDD;

}  // namespace

std::uint32_t crc32(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t crc = 0xffffffff;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) {
      crc = crc >> 1 ^ (0xedb88320 & (0U - (crc & 1)));
    }
  }
  return ~crc;
}

std::span<const std::uint8_t> FrameReader::take(std::uint8_t byte) noexcept {
  if (byte == kEnd) {
    const std::size_t size = broken_ || escaped_ ? 0 : size_;
    size_ = 0;
    escaped_ = broken_ = false;
    return {bytes_.data(), size};
  }
  if (byte == kEscape && !escaped_) {
    escaped_ = true;
    return {};
  }
  if (escaped_) {
    broken_ = broken_ || (byte != kEscapedEnd && byte != kEscapedEscape);
    byte = byte == kEscapedEnd ? kEnd : kEscape;
    escaped_ = false;
  }
  if (size_ == bytes_.size()) {
    broken_ = true;
    return {};
  }
  bytes_[size_++] = byte;
  return {};
}

bool FrameWriter::put(std::span<const std::uint8_t> frame) noexcept {
  if (first_ == end_) {
    first_ = end_ = 0;
  }
  std::size_t end = end_;
  const auto append = [&](std::uint8_t byte) {
    if (end < bytes_.size()) {
      bytes_[end] = byte;
    }
    ++end;
  };
  for (const std::uint8_t byte : frame) {
    if (byte == kEnd || byte == kEscape) {
      append(kEscape);
      append(byte == kEnd ? kEscapedEnd : kEscapedEscape);
    } else {
      append(byte);
    }
  }
  append(kEnd);
  if (end > bytes_.size()) {
    return false;
  }
  end_ = end;
  return true;
}

}  // namespace forcegrid::firmware
