// SPDX-License-Identifier: Apache-2.0
#include "rt/local_datagrams.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <stdexcept>

namespace forcegrid::rt {
namespace {

bool fits(const std::string& path) {
  return !path.empty() && path.size() < sizeof(sockaddr_un::sun_path);
}

sockaddr_un address_of(const std::string& path) noexcept {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::copy_n(path.begin(), std::min(path.size(), sizeof(address.sun_path) - 1), address.sun_path);
  return address;
}

// Binds; in place of a socket that its process has left behind, as one that was killed does.
bool bind_to(int socket, const sockaddr_un& address) noexcept {
  const auto* name = reinterpret_cast<const sockaddr*>(&address);
  if (::bind(socket, name, sizeof(address)) == 0) {
    return true;
  }
  if (errno != EADDRINUSE) {
    return false;
  }
  const bool left_behind = ::connect(socket, name, sizeof(address)) != 0 && errno == ECONNREFUSED;
  struct stat file {};
  if (left_behind && ::lstat(address.sun_path, &file) == 0 && S_ISSOCK(file.st_mode)) {
    ::unlink(address.sun_path);
    return ::bind(socket, name, sizeof(address)) == 0;
  }
  errno = EADDRINUSE;
  return false;
}

}  // namespace

LocalDatagrams::LocalDatagrams(const std::string& path) : path_(path) {
  if (!fits(path)) {
    throw std::runtime_error("'" + path + "': a path has 1 to " +
                             std::to_string(sizeof(sockaddr_un::sun_path) - 1) + " characters");
  }
  const sockaddr_un address = address_of(path);
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  // The mode of a socket before bind() is that of the file that bind() makes, so that nobody else
  // can write to it at any moment.
  if (socket_ < 0 || ::fchmod(socket_, S_IRUSR | S_IWUSR) != 0 || !bind_to(socket_, address)) {
    const int error = errno;
    if (socket_ >= 0) {
      ::close(socket_);
    }
    throw std::runtime_error(path + ": " + std::strerror(error) +
                             (error == EADDRINUSE
                                  ? "; remove the file if no program uses it"
                                  : "; give a path in a folder that you may write to"));
  }
}

LocalDatagrams::~LocalDatagrams() {
  ::close(socket_);
  ::unlink(path_.c_str());
}

ssize_t LocalDatagrams::receive(std::span<std::uint8_t> bytes) noexcept {
  sockaddr_un sender{};
  socklen_t size = sizeof(sender);
  // MSG_TRUNC: returns a longer datagram's true length.
  const ssize_t taken = ::recvfrom(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_TRUNC,
                                   reinterpret_cast<sockaddr*>(&sender), &size);
  if (taken >= 0) {
    sender_ = sender;
    sender_bytes_ = size;
  }
  return taken;
}

bool LocalDatagrams::reply(std::span<const std::uint8_t> bytes) noexcept {
  return sender_bytes_ > offsetof(sockaddr_un, sun_path) &&
         ::sendto(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&sender_), sender_bytes_) >= 0;
}

bool LocalDatagrams::send(const std::string& path, std::span<const std::uint8_t> bytes) noexcept {
  const sockaddr_un address = address_of(path);
  return ::sendto(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address), sizeof(address)) >= 0;
}

}  // namespace forcegrid::rt
