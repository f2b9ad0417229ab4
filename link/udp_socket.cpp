// SPDX-License-Identifier: Apache-2.0
#include "link/udp_socket.h"

#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <string>
#include <system_error>

namespace forcegrid::link {
namespace {

/// The system halves what its own limit allows; enough for a solver of 100 ms behind a 4 kHz servo.
constexpr int kReceiveBuffer_bytes = 1 << 20;
constexpr int kMaxErrorsPerCall = 256;

struct SocketAddress {
  sockaddr_storage storage{};
  socklen_t size = 0;
};

SocketAddress to_system(const Address& address) noexcept {
  SocketAddress result;
  if (address.is_ipv6) {
    sockaddr_in6 ipv6{};
    ipv6.sin6_family = AF_INET6;
    ipv6.sin6_port = htons(address.port);
    std::memcpy(&ipv6.sin6_addr, address.bytes.data(), sizeof ipv6.sin6_addr);
    std::memcpy(&result.storage, &ipv6, sizeof ipv6);
    result.size = sizeof ipv6;
  } else {
    sockaddr_in ipv4{};
    ipv4.sin_family = AF_INET;
    ipv4.sin_port = htons(address.port);
    std::memcpy(&ipv4.sin_addr, address.bytes.data(), sizeof ipv4.sin_addr);
    std::memcpy(&result.storage, &ipv4, sizeof ipv4);
    result.size = sizeof ipv4;
  }
  return result;
}

Address from_system(const sockaddr_storage& storage) noexcept {
  Address address;
  if (storage.ss_family == AF_INET6) {
    sockaddr_in6 ipv6{};
    std::memcpy(&ipv6, &storage, sizeof ipv6);
    address.is_ipv6 = true;
    address.port = ntohs(ipv6.sin6_port);
    std::memcpy(address.bytes.data(), &ipv6.sin6_addr, sizeof ipv6.sin6_addr);
  } else {
    sockaddr_in ipv4{};
    std::memcpy(&ipv4, &storage, sizeof ipv4);
    address.port = ntohs(ipv4.sin_port);
    std::memcpy(address.bytes.data(), &ipv4.sin_addr, sizeof ipv4.sin_addr);
  }
  return address;
}

[[noreturn]] void fail(const Address& address, const char* action, int error) {
  std::string remedy;
  if (error == EADDRINUSE) {
    remedy = "; another program listens there: end it, or choose another port (0 takes a free one)";
  } else if (error == EACCES) {
    remedy = "; ports below 1024 need privileges: choose a higher one";
  } else if (error == EADDRNOTAVAIL || error == EAFNOSUPPORT) {
    remedy =
        "; this machine does not have that address: use one that 'ip address' shows, or "
        "127.0.0.1";
  }
  throw LinkError("link at " + to_string(address) + ": " + action + ": " +
                  std::generic_category().message(error) + remedy);
}

}  // namespace

UdpSocket::UdpSocket(const Address& local) {
  descriptor_ = ::socket(local.is_ipv6 ? AF_INET6 : AF_INET,
                         SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_UDP);
  if (descriptor_ < 0) {
    fail(local, "open a socket", errno);
  }
  const auto close_and_fail = [&](const char* action) {
    const int error = errno;
    ::close(descriptor_);
    fail(local, action, error);
  };
  const int on = 1;
  if (::setsockopt(descriptor_, local.is_ipv6 ? IPPROTO_IPV6 : IPPROTO_IP,
                   local.is_ipv6 ? IPV6_RECVERR : IP_RECVERR, &on, sizeof on) != 0) {
    close_and_fail("ask for error reports");
  }
  if (::setsockopt(descriptor_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on) != 0) {
    close_and_fail("ask for the count of dropped datagrams");
  }
  if (local.is_ipv6 && ::setsockopt(descriptor_, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on) != 0) {
    close_and_fail("leave IPv4 to sockets of its own");
  }
  if (::setsockopt(descriptor_, SOL_SOCKET, SO_RCVBUF, &kReceiveBuffer_bytes,
                   sizeof kReceiveBuffer_bytes) != 0) {
    close_and_fail("set the receive buffer");
  }
  const SocketAddress system = to_system(local);
  if (::bind(descriptor_, reinterpret_cast<const sockaddr*>(&system.storage), system.size) != 0) {
    close_and_fail("bind");
  }
  SocketAddress bound;
  bound.size = sizeof bound.storage;
  if (::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&bound.storage), &bound.size) != 0) {
    close_and_fail("read back the address");
  }
  local_ = from_system(bound.storage);
}

UdpSocket::~UdpSocket() { ::close(descriptor_); }

int UdpSocket::send_to(const Address& peer, std::span<const std::byte> datagram) noexcept {
  const SocketAddress system = to_system(peer);
  for (int attempt = 0;; ++attempt) {
    if (::sendto(descriptor_, datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                 reinterpret_cast<const sockaddr*>(&system.storage), system.size) >= 0) {
      return 0;
    }
    const int error = errno;
    // The system reports an earlier datagram's failure instead of sending this one.
    if (error == ECONNREFUSED) {
      take_in_errors();
    }
    if ((error != ECONNREFUSED && error != EINTR) || attempt == 1) {
      return error;
    }
  }
}

UdpSocket::Received UdpSocket::receive(std::span<std::byte> buffer) noexcept {
  for (int attempt = 0; attempt < 2; ++attempt) {
    SocketAddress sender;
    iovec where = {buffer.data(), buffer.size()};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof overrun_)> control;
    msghdr message{};
    message.msg_name = &sender.storage;
    message.msg_namelen = sizeof sender.storage;
    message.msg_iov = &where;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    const ssize_t size = ::recvmsg(descriptor_, &message, MSG_DONTWAIT | MSG_TRUNC);
    if (size >= 0) {
      const cmsghdr* note = CMSG_FIRSTHDR(&message);
      if (note != nullptr && note->cmsg_level == SOL_SOCKET && note->cmsg_type == SO_RXQ_OVFL) {
        std::memcpy(&overrun_, CMSG_DATA(note), sizeof overrun_);
      }
      return {Received::Kind::kDatagram, static_cast<std::size_t>(size),
              from_system(sender.storage)};
    }
    if (errno == EAGAIN) {
      break;
    }
    take_in_errors();
  }
  return {};
}

UdpSocket::Wait UdpSocket::wait(std::chrono::nanoseconds timeout) noexcept {
  const auto deadline =
      std::chrono::steady_clock::now() + std::max(timeout, std::chrono::nanoseconds::zero());
  while (true) {
    const auto left = std::max(std::chrono::duration_cast<std::chrono::nanoseconds>(
                                   deadline - std::chrono::steady_clock::now()),
                               std::chrono::nanoseconds::zero());
    const timespec limit = {static_cast<std::time_t>(left.count() / 1'000'000'000),
                            static_cast<long>(left.count() % 1'000'000'000)};
    pollfd entry = {descriptor_, POLLIN, 0};
    const int ready = ::ppoll(&entry, 1, &limit, nullptr);
    if (ready < 0) {
      return Wait::kInterrupted;
    }
    if ((entry.revents & POLLIN) != 0) {
      return Wait::kReadable;
    }
    if (ready == 0) {
      return Wait::kTimeout;
    }
    take_in_errors();  // an error report alone must not turn the wait into a spin
  }
}

void UdpSocket::take_in_errors() noexcept {
  for (int i = 0; i < kMaxErrorsPerCall; ++i) {
    msghdr message{};
    if (::recvmsg(descriptor_, &message, MSG_ERRQUEUE | MSG_DONTWAIT) < 0) {
      break;
    }
    ++undelivered_;
  }
  int pending = 0;
  socklen_t size = sizeof pending;
  ::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &pending, &size);
}

}  // namespace forcegrid::link
