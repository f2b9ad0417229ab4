// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "link/wire.h"

namespace forcegrid::link {

inline constexpr int kPatience_ms = 20'000;  ///< how long a test waits for what must come

/// A bare socket at 127.0.0.1 that sends and receives any bytes: the other side of the endpoint
/// under test, a stranger, or a forger.
class RawPeer {
 public:
  explicit RawPeer(std::uint16_t port = 0) : descriptor_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    sockaddr_in address = loopback(port);
    socklen_t size = sizeof address;
    if (descriptor_ < 0 ||
        ::bind(descriptor_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        ::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      throw std::runtime_error("raw peer: no socket");
    }
    port_ = ntohs(address.sin_port);
  }
  ~RawPeer() { ::close(descriptor_); }
  RawPeer(const RawPeer&) = delete;
  RawPeer& operator=(const RawPeer&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

  void send_to(std::uint16_t port, std::span<const std::byte> bytes) const {
    const sockaddr_in address = loopback(port);
    if (::sendto(descriptor_, bytes.data(), bytes.size(), 0,
                 reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0) {
      throw std::runtime_error("raw peer: send failed");
    }
  }

  template <typename Message>
  void send_message(std::uint16_t port, const Message& message, std::uint64_t session_id,
                    ToolId tool = 0, Content content = Content::kPosition) const {
    std::array<std::byte, kMaxDatagramBytes> buffer;
    const Encoded encoded = encode(message, session_id, buffer, tool, content);
    if (encoded.status != WireStatus::kOk) {
      throw std::runtime_error("raw peer: the test's message is not valid");
    }
    send_to(port, std::span(buffer).first(encoded.size_bytes));
  }

  /// The next datagram, decoded; nothing if none comes within `patience_ms`.
  std::optional<Decoded> receive(int patience_ms = kPatience_ms) const {
    pollfd entry = {descriptor_, POLLIN, 0};
    if (::poll(&entry, 1, patience_ms) != 1) {
      return std::nullopt;
    }
    std::array<std::byte, 2048> buffer;
    socklen_t address_size = sizeof sender_;
    const ssize_t size = ::recvfrom(descriptor_, buffer.data(), buffer.size(), 0,
                                    reinterpret_cast<sockaddr*>(&sender_), &address_size);
    if (size < 0) {
      return std::nullopt;
    }
    return decode(std::span(buffer).first(static_cast<std::size_t>(size)));
  }

  /// Sends a message to whoever sent what receive() gave last.
  template <typename Message>
  void answer(const Message& message, std::uint64_t session_id) const {
    send_message(ntohs(sender_.sin_port), message, session_id);
  }

  template <typename Message>
  Message expect_message() const {
    const auto decoded = receive();
    if (!decoded || !std::holds_alternative<Message>(decoded->message)) {
      throw std::runtime_error("raw peer: the expected message did not come");
    }
    return std::get<Message>(decoded->message);
  }

 private:
  static sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
  }

  int descriptor_;
  std::uint16_t port_ = 0;
  mutable sockaddr_in sender_{};  ///< of the datagram received last
};

}  // namespace forcegrid::link
