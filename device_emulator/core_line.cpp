// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/core_line.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "device_emulator/listen_socket.h"

namespace forcegrid::emulator {
namespace {

constexpr std::uint8_t kEnd = 0xC0, kEscape = 0xDB, kEscapedEnd = 0xDC, kEscapedEscape = 0xDD;

// The CRC-32 of zlib, PNG and Ethernet: polynomial 0x04C11DB7 reflected.
std::uint32_t crc32(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) {
      crc = (crc >> 1) ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
    }
  }
  return crc ^ 0xFFFFFFFFU;
}

void put_u32(std::span<std::uint8_t> bytes, std::uint32_t value) noexcept {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

std::uint32_t get_u32(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value |= static_cast<std::uint32_t>(bytes[i]) << (8 * i);
  }
  return value;
}

}  // namespace

CoreLine::CoreLine(const std::string& path)
    : socket_(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const bool fits = path.size() < sizeof address.sun_path;
  if (fits) {
    path.copy(address.sun_path, path.size());
  }
  if (!fits ||
      ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    const std::string reason = fits ? std::strerror(errno) : "the path is too long";
    ::close(socket_);
    throw EmulatorError("no processor at the line " + path + ": " + reason +
                        "; start it first, see docs/firmware.md");
  }
}

CoreLine::~CoreLine() { ::close(socket_); }

void CoreLine::send(std::uint32_t number, const std::array<std::int32_t, 6>& counters) noexcept {
  std::array<std::uint8_t, kStateBytes> state{};
  const std::span<std::uint8_t> bytes(state);
  put_u32(bytes, number);
  for (std::size_t i = 0; i < counters.size(); ++i) {
    put_u32(bytes.subspan(4 + 4 * i), static_cast<std::uint32_t>(counters[i]));
  }
  put_u32(bytes.subspan(kStateBytes - 4), crc32(bytes.first(kStateBytes - 4)));
  std::array<std::uint8_t, 2 * kStateBytes + 1> line{};
  std::size_t size = 0;
  for (const std::uint8_t byte : state) {
    if (byte == kEnd || byte == kEscape) {
      line[size++] = kEscape;
      line[size++] = byte == kEnd ? kEscapedEnd : kEscapedEscape;
    } else {
      line[size++] = byte;
    }
  }
  line[size++] = kEnd;
  static_cast<void>(::send(socket_, line.data(), size, MSG_NOSIGNAL | MSG_DONTWAIT));
}

std::optional<CoreLine::Answer> CoreLine::end_frame() noexcept {
  const std::size_t size = escaped_ ? 0 : size_;
  size_ = 0;
  escaped_ = false;
  const std::span<const std::uint8_t> bytes(frame_.data(), kAnswerBytes);
  if (size != kAnswerBytes ||
      get_u32(bytes.subspan(kAnswerBytes - 4)) != crc32(bytes.first(kAnswerBytes - 4))) {
    ++broken_frames_;
    return std::nullopt;
  }
  Answer answer;
  answer.number = get_u32(bytes);
  for (std::size_t motor = 0; motor < 3; ++motor) {
    answer.current_mA[motor] = static_cast<std::int16_t>(
        bytes[4 + 2 * motor] | static_cast<std::uint16_t>(bytes[5 + 2 * motor] << 8));
  }
  return answer;
}

std::optional<CoreLine::Answer> CoreLine::receive() noexcept {
  std::array<std::uint8_t, kReadBytes> bytes;
  const ssize_t count = ::recv(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT);
  std::optional<Answer> newest;
  for (ssize_t i = 0; i < count; ++i) {
    std::uint8_t byte = bytes[static_cast<std::size_t>(i)];
    if (byte == kEnd) {
      if (const auto answer = end_frame()) {
        newest = answer;
      }
      continue;
    }
    if (byte == kEscape && !escaped_) {
      escaped_ = true;
      continue;
    }
    if (escaped_) {
      byte = byte == kEscapedEnd ? kEnd : kEscape;
      escaped_ = false;
    }
    if (size_ < frame_.size()) {
      frame_[size_] = byte;
    }
    size_ = size_ < frame_.size() ? size_ + 1 : frame_.size();
  }
  return newest;
}

}  // namespace forcegrid::emulator
