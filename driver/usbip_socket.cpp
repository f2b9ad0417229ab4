// SPDX-License-Identifier: Apache-2.0
#include "driver/usbip_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>

#include "driver/device.h"

namespace forcegrid::driver {

void Socket::close() noexcept {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
    descriptor_ = -1;
  }
}

Ready wait_either(int socket, short events, int other, rt::TimePoint deadline) noexcept {
  for (;;) {
    const auto left = std::max(deadline - rt::Clock::now(), rt::Duration::zero());
    const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
    const timespec time{
        .tv_sec = whole.count(),
        .tv_nsec = static_cast<long>(
            std::chrono::duration_cast<std::chrono::nanoseconds>(left - whole).count())};
    pollfd entries[2] = {{.fd = socket, .events = events, .revents = 0},
                         {.fd = other, .events = POLLIN, .revents = 0}};
    const int ready = ::ppoll(entries, 2, &time, nullptr);
    if (ready > 0) {
      return entries[0].revents != 0 ? Ready::kSocket : Ready::kOther;
    }
    if (ready == 0 || errno != EINTR) {
      return Ready::kTimeout;
    }
  }
}

bool wait_ready(int socket, short events, rt::TimePoint deadline) noexcept {
  return wait_either(socket, events, -1, deadline) == Ready::kSocket;
}

void fail_open(const DeviceUrl& url, const std::string& problem) {
  throw DeviceError("device '" + url.text + "': " + problem);
}

Socket connect_to(const DeviceUrl& url, rt::TimePoint deadline) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICSERV;
  addrinfo* list = nullptr;
  const int unresolved =
      ::getaddrinfo(url.host.c_str(), std::to_string(url.tcp_port).c_str(), &hints, &list);
  if (unresolved != 0) {
    fail_open(url, "host '" + url.host + "': " + ::gai_strerror(unresolved) +
                       "; write a name that resolves or an address");
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> addresses(list, &::freeaddrinfo);
  std::string reason = "no address";
  for (const addrinfo* address = list; address != nullptr; address = address->ai_next) {
    Socket socket(::socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
                           address->ai_protocol));
    if (socket.get() < 0) {
      reason = std::strerror(errno);
      continue;
    }
    int error = 0;
    if (::connect(socket.get(), address->ai_addr, address->ai_addrlen) != 0) {
      error = errno;
      if (error == EINPROGRESS) {
        socklen_t size = sizeof error;
        if (!wait_ready(socket.get(), POLLOUT, deadline)) {
          error = ETIMEDOUT;
        } else if (::getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &error, &size) != 0) {
          error = errno;
        }
      }
    }
    if (error == 0) {
      const int on = 1;
      if (::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) != 0) {
        fail_open(url, std::string("TCP_NODELAY: ") + std::strerror(errno) +
                           "; run on a system that has it");
      }
      return socket;
    }
    reason = std::strerror(error);
  }
  fail_open(url, "connect: " + reason +
                     "; start the USB/IP server (`forcegrid emulate` or usbipd) "
                     "there, or correct host and port");
}

}  // namespace forcegrid::driver
