// SPDX-License-Identifier: Apache-2.0
#include "view_link/frame.h"

#include "view_link/little_endian.h"

namespace forcegrid::view_link {

Bytes bytes_of(const Frame& frame) {
  Bytes bytes;
  bytes.reserve(kHeaderBytes + frame.payload.size());
  append(bytes, static_cast<std::uint32_t>(frame.payload.size()));
  append(bytes, frame.type);
  append(bytes, frame.object);
  append(bytes, std::span<const std::uint8_t>(frame.payload));
  return bytes;
}

Frame text_frame(std::uint16_t type, const std::string& text) {
  return {type, 0, Bytes(text.begin(), text.end())};
}

std::string text_of(const Frame& frame) { return {frame.payload.begin(), frame.payload.end()}; }

void FrameReader::add(std::span<const std::uint8_t> piece) {
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(taken_));
  taken_ = 0;
  append(buffer_, piece);
}

std::optional<Frame> FrameReader::next() {
  const auto rest = std::span<const std::uint8_t>(buffer_).subspan(taken_);
  if (rest.size() < kHeaderBytes) {
    return std::nullopt;
  }
  Reader reader(rest);
  const auto payload_bytes = reader.take<std::uint32_t>();
  Frame frame;
  frame.type = reader.take<std::uint16_t>();
  frame.object = reader.take<std::uint16_t>();
  if (payload_bytes > largest_payload_) {
    throw ViewLinkError("a frame of type " + std::to_string(frame.type) + " has " +
                        std::to_string(payload_bytes) + " bytes; at most " +
                        std::to_string(largest_payload_) + " are taken");
  }
  if (rest.size() < kHeaderBytes + payload_bytes) {
    return std::nullopt;
  }
  const auto payload = rest.subspan(kHeaderBytes, payload_bytes);
  frame.payload.assign(payload.begin(), payload.end());
  taken_ += kHeaderBytes + payload_bytes;
  return frame;
}

}  // namespace forcegrid::view_link
