// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace forcegrid::view_link {

using Bytes = std::vector<std::uint8_t>;

/// What is wrong with a stream to the live view, or with its socket; for people.
class ViewLinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Bytes of a frame's header: u32 bytes of the payload, u16 type, u16 object; little-endian.
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kLargestFeedPayload = std::size_t{64} << 10;
inline constexpr std::size_t kLargestSurfacePayload = std::size_t{64} << 20;

/// What comes over a local socket, one after the other (docs/view_protocol.md).
struct Frame {
  std::uint16_t type = 0;
  std::uint16_t object = 0;
  Bytes payload;
};

/// The frame as it is sent. Its payload has at most 2^32 - 1 bytes.
Bytes bytes_of(const Frame& frame);
/// A frame whose payload is a text.
Frame text_frame(std::uint16_t type, const std::string& text);
/// The payload as a text.
std::string text_of(const Frame& frame);

/// Takes frames from a stream of bytes that comes in pieces.
/// Threads: one.
class FrameReader {
 public:
  /// @param largest_payload  [bytes] a larger one is refused; what is kept never exceeds it by
  /// more than one piece.
  explicit FrameReader(std::size_t largest_payload) : largest_payload_(largest_payload) {}

  void add(std::span<const std::uint8_t> piece);
  /// The next whole frame; nothing until more has come.
  /// @throws ViewLinkError for a frame that is too large, after which the stream is of no use.
  std::optional<Frame> next();

 private:
  std::size_t largest_payload_;
  Bytes buffer_;
  std::size_t taken_ = 0;  ///< bytes at the buffer's begin that next() has returned
};

}  // namespace forcegrid::view_link
