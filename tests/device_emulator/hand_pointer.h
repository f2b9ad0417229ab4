// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace forcegrid::emulator {

/// Who points: sends datagrams to the emulator's socket for the hand.
class HandPointer {
 public:
  explicit HandPointer(const std::string& path) : socket_(::socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::copy(path.begin(), path.end(), address.sun_path);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  }
  ~HandPointer() { ::close(socket_); }
  HandPointer(const HandPointer&) = delete;
  HandPointer& operator=(const HandPointer&) = delete;

  void send(const std::array<double, 3>& target_m) const {
    EXPECT_EQ(::send(socket_, target_m.data(), sizeof(target_m), 0),
              static_cast<ssize_t>(sizeof(target_m)));
  }
  void send_bytes(std::size_t count) const {
    const std::vector<char> bytes(count, 0);
    EXPECT_EQ(::send(socket_, bytes.data(), count, 0), static_cast<ssize_t>(count));
  }

 private:
  int socket_;
};

}  // namespace forcegrid::emulator
