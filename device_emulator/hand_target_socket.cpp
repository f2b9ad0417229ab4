// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_target_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace forcegrid::emulator {
namespace {

static_assert(std::endian::native == std::endian::little, "a datagram is copied as it is");

FileDescriptor bind_datagrams_at(const std::string& path) {
  const std::string socket_at = "the hand's socket " + path + ": ";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(address.sun_path)) {
    throw EmulatorError("the hand's socket '" + path + "': a path has 1 to " +
                        std::to_string(sizeof(address.sun_path) - 1) + " characters");
  }
  std::copy(path.begin(), path.end(), address.sun_path);
  FileDescriptor socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  // The mode of a socket before bind() is that of the file that bind() makes, so that nobody else
  // can write to it at any moment.
  if (socket.get() < 0 || ::fchmod(socket.get(), S_IRUSR | S_IWUSR) != 0) {
    throw EmulatorError(socket_at + std::strerror(errno));
  }
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    const int error = errno;
    throw EmulatorError(socket_at + std::strerror(error) +
                        (error == EADDRINUSE ? "; remove the file if no emulator uses it"
                                             : "; give a path in a folder that you may write to"));
  }
  return socket;
}

}  // namespace

HandTargetSocket::HandTargetSocket(const std::string& path)
    : path_(path), socket_(bind_datagrams_at(path)) {}

HandTargetSocket::~HandTargetSocket() { ::unlink(path_.c_str()); }

bool HandTargetSocket::receive() noexcept {
  bool news = false;
  for (int i = 0; i < kMostAtOnce; ++i) {
    std::array<double, 3> target{};
    // MSG_TRUNC: returns a longer datagram's true length.
    const ssize_t bytes =
        ::recv(socket_.get(), target.data(), kDatagramBytes, MSG_DONTWAIT | MSG_TRUNC);
    if (bytes < 0) {
      break;
    }
    const auto finite = std::count_if(target.begin(), target.end(),
                                      [](double value) { return std::isfinite(value); });
    const bool lets_go =
        std::all_of(target.begin(), target.end(), [](double value) { return std::isnan(value); });
    if (bytes != static_cast<ssize_t>(kDatagramBytes) || (finite != 3 && !lets_go)) {
      ++use_.malformed;
      continue;
    }
    ++use_.taken;
    news = true;
    if (lets_go) {
      target_D_.reset();
    } else {
      target_D_ = Eigen::Vector3d(target[0], target[1], target[2]);
    }
  }
  return news;
}

}  // namespace forcegrid::emulator
