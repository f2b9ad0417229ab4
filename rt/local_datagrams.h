// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/socket.h>
#include <sys/types.h>
#include <sys/un.h>

#include <cstdint>
#include <span>
#include <string>

namespace forcegrid::rt {

/// A Unix datagram socket at a path, which only this user may write to (mode 0600), for commands
/// between the processes of a run and their answers.
///
/// Real-time: receive(), reply() and send() neither wait, allocate, lock nor throw; one system call
/// each. Threads: one.
class LocalDatagrams {
 public:
  /// Replaces a socket that no process has any more.
  /// @throws std::runtime_error with the path, the system's words and the remedy.
  explicit LocalDatagrams(const std::string& path);
  /// Removes the socket's file.
  ~LocalDatagrams();
  LocalDatagrams(const LocalDatagrams&) = delete;
  LocalDatagrams& operator=(const LocalDatagrams&) = delete;

  /// Takes a datagram and remembers who sent it.
  /// @returns its whole length, also of one that is longer than `bytes`; -1: none waits.
  ssize_t receive(std::span<std::uint8_t> bytes) noexcept;

  /// To the sender of the newest datagram. False: it has no address, is gone, or does not read.
  bool reply(std::span<const std::uint8_t> bytes) noexcept;

  /// To the socket at `path`. False: the error is in errno.
  bool send(const std::string& path, std::span<const std::uint8_t> bytes) noexcept;

  [[nodiscard]] int descriptor() const noexcept { return socket_; }

 private:
  std::string path_;
  int socket_ = -1;
  sockaddr_un sender_{};
  socklen_t sender_bytes_ = 0;
};

}  // namespace forcegrid::rt
