// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "view_link/frame.h"
#include "view_link/inside_messages.h"
#include "view_link/surface_messages.h"

namespace forcegrid::simulator::testing {

/// The live view's end of a surface stream: a listening Unix socket in a folder of its own.
class SurfaceView {
 public:
  SurfaceView() {
    char folder[] = "/tmp/forcegrid_surface_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string where = path();
    std::copy(where.begin(), where.end(), address.sun_path);
    listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    EXPECT_EQ(::bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    EXPECT_EQ(::listen(listener_, 1), 0);
  }
  ~SurfaceView() {
    hang_up();
    ::close(listener_);
    std::filesystem::remove_all(folder_);
  }
  SurfaceView(const SurfaceView&) = delete;
  SurfaceView& operator=(const SurfaceView&) = delete;

  std::string path() const { return folder_ + "/surface"; }

  /// Ends the connection.
  void hang_up() {
    if (connection_ >= 0) {
      ::close(connection_);
      connection_ = -1;
    }
  }

  /// Takes the connection that waits, so that it can be hung up.
  void accept() {
    if (connection_ < 0 && readable(listener_, std::chrono::seconds(20))) {
      connection_ = ::accept(listener_, nullptr, nullptr);
    }
  }

  /// The next frame; nothing if none comes within `patience`.
  std::optional<view_link::Frame> next(
      std::chrono::milliseconds patience = std::chrono::seconds(20)) {
    accept();
    for (;;) {
      if (auto frame = reader_.next()) {
        return frame;
      }
      std::array<std::uint8_t, 65536> piece;
      if (connection_ < 0 || !readable(connection_, patience)) {
        return std::nullopt;
      }
      const ssize_t bytes = ::recv(connection_, piece.data(), piece.size(), 0);
      if (bytes <= 0) {
        return std::nullopt;
      }
      reader_.add({piece.data(), static_cast<std::size_t>(bytes)});
    }
  }

  /// Tells the simulator whether its inside is wished.
  void wish(bool inside) { send(view_link::bytes_of(view_link::encode_wish(inside))); }

  void send(const view_link::Bytes& bytes) {
    accept();
    EXPECT_EQ(::send(connection_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }

  /// The next frame as a shape; nothing if it is none.
  std::optional<view_link::SurfaceShape> next_shape() {
    const auto frame = next();
    const bool is_shape =
        frame && frame->type == static_cast<std::uint16_t>(view_link::SurfaceType::kShape);
    return is_shape ? view_link::decode_shape(frame->payload) : std::nullopt;
  }

  /// The next frame as positions; nothing if it is none.
  std::optional<view_link::SurfaceFrame> next_positions(
      std::chrono::milliseconds patience = std::chrono::seconds(20)) {
    const auto frame = next(patience);
    const bool is_frame =
        frame && frame->type == static_cast<std::uint16_t>(view_link::SurfaceType::kFrame);
    return is_frame ? view_link::decode_frame(frame->payload) : std::nullopt;
  }

 private:
  static bool readable(int socket, std::chrono::milliseconds patience) {
    pollfd watched{socket, POLLIN, 0};
    return ::poll(&watched, 1, static_cast<int>(patience.count())) > 0;
  }

  std::string folder_;
  int listener_ = -1;
  int connection_ = -1;
  view_link::FrameReader reader_{view_link::kLargestSurfacePayload};
};

}  // namespace forcegrid::simulator::testing
