// SPDX-License-Identifier: Apache-2.0
#include "driver/usbip_list.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <span>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

constexpr std::array<std::uint8_t, 8> kListRequest = {0x01, 0x11, 0x80, 0x05, 0, 0, 0, 0};
constexpr std::array<std::uint8_t, 4> kListReply = {0x01, 0x11, 0x00, 0x05};
constexpr std::uint32_t kMostDevices = 1024;
constexpr std::size_t kDeviceBytes = 312;
constexpr std::size_t kBusIdOffset = 256;
constexpr std::size_t kBusIdFieldBytes = 32;
constexpr std::size_t kVendorOffset = 300;  // behind busnum, devnum and speed
constexpr std::size_t kProductOffset = 302;
constexpr std::size_t kInterfacesOffset = 311;
constexpr std::size_t kInterfaceBytes = 4;

class Connection {
 public:
  Connection(const std::string& host, std::uint16_t port, rt::Duration timeout)
      : name_("USB/IP server " + host + ":" + std::to_string(port)) {
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_NUMERICSERV;
    addrinfo* list = nullptr;
    if (const int error =
            ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &list)) {
      throw DeviceError(name_ + ": " + ::gai_strerror(error) + "; check the host's name");
    }
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> keep(list, ::freeaddrinfo);
    const auto whole = std::chrono::duration_cast<std::chrono::microseconds>(timeout).count();
    const timeval limit{.tv_sec = whole / 1'000'000, .tv_usec = whole % 1'000'000};
    for (const addrinfo* at = list; at != nullptr && socket_ < 0; at = at->ai_next) {
      socket_ = ::socket(at->ai_family, at->ai_socktype | SOCK_CLOEXEC, at->ai_protocol);
      ::setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);  // of connect, too
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
      if (socket_ >= 0 && ::connect(socket_, at->ai_addr, at->ai_addrlen) != 0) {
        reason_ = errno;
        ::close(socket_);
        socket_ = -1;
      }
    }
    if (socket_ < 0) {
      // Linux has EINPROGRESS for a connect that ran out of its time.
      throw DeviceError(name_ + ": " + std::strerror(reason_ == EINPROGRESS ? ETIMEDOUT : reason_) +
                        "; start the server there (usbipd, or forcegrid emulate), or correct the "
                        "port");
    }
  }
  ~Connection() {
    if (socket_ >= 0) {
      ::close(socket_);
    }
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void send(std::span<const std::uint8_t> bytes) const {
    if (::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(bytes.size())) {
      throw DeviceError(name_ + ": " + std::strerror(errno) + "; try again");
    }
  }
  void receive(std::span<std::uint8_t> bytes) const {
    for (std::size_t got = 0; got < bytes.size();) {
      const ssize_t count = ::recv(socket_, bytes.data() + got, bytes.size() - got, 0);
      if (count <= 0) {
        throw DeviceError(name_ + ": " +
                          (count == 0        ? "ended the connection within its list"
                           : errno == EAGAIN ? "no answer in time"
                                             : std::strerror(errno)) +
                          "; check that it is a USB/IP server of version 1.1.1");
      }
      got += static_cast<std::size_t>(count);
    }
  }
  [[noreturn]] void refuse(const std::string& what) const {
    throw DeviceError(name_ + ": " + what + "; check that it is a USB/IP server of version 1.1.1");
  }

 private:
  std::string name_;
  int socket_ = -1;
  int reason_ = 0;
};

std::uint16_t get16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::uint16_t>((bytes[0] << 8) | bytes[1]);
}

}  // namespace

std::vector<UsbipListing> list_usbip_devices(const std::string& host, std::uint16_t port,
                                             rt::Duration timeout) {
  const Connection server(host, port, timeout);
  server.send(kListRequest);
  std::array<std::uint8_t, 12> header{};
  server.receive(header);
  if (std::memcmp(header.data(), kListReply.data(), kListReply.size()) != 0 ||
      (header[4] | header[5] | header[6] | header[7]) != 0) {
    server.refuse("its answer is no list of devices");
  }
  const std::uint32_t count =
      (static_cast<std::uint32_t>(get16(&header[8])) << 16) | get16(&header[10]);
  if (count > kMostDevices) {
    server.refuse("it announces " + std::to_string(count) + " devices");
  }
  std::vector<UsbipListing> devices;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::array<std::uint8_t, kDeviceBytes> bytes{};
    server.receive(bytes);
    const char* const bus_id = reinterpret_cast<const char*>(&bytes[kBusIdOffset]);
    devices.push_back({std::string(bus_id, ::strnlen(bus_id, kBusIdFieldBytes)),
                       get16(&bytes[kVendorOffset]), get16(&bytes[kProductOffset])});
    std::vector<std::uint8_t> interfaces(kInterfaceBytes * bytes[kInterfacesOffset]);
    server.receive(interfaces);
  }
  return devices;
}

}  // namespace forcegrid::driver
