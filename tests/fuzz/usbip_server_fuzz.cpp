// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <vector>

#include "device_emulator/emulator_server.h"
#include "profiles/device_profile.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

using namespace emulator;

// One server for all inputs: what a client does must not spoil the device for the next.
EmulatorServer& server() {
  static EmulatorServer* const instance = [] {
    ServerOptions options;
    options.listen = "127.0.0.1:0";
    options.devices.emplace_back();
    options.devices.back().profile = profiles::load_device_profile("woodenhaptics_v2015");
    options.devices.back().profile.usb.frame_period_us = 125;  // so that many inputs fit a second
    auto* const made = new EmulatorServer(options);            // ends with the process
    made->start();
    return made;
  }();
  return *instance;
}

}  // namespace

void usbip_server(Input input) {
  const int client = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(server().port());
  require(::connect(client, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0,
          "the server takes the next client");
  const linger at_once{1, 0};  // used ports don't pile up
  ::setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  std::size_t sent = 0;
  while (sent < input.size()) {
    const ssize_t count = ::send(client, input.data() + sent, input.size() - sent, MSG_NOSIGNAL);
    if (count <= 0) {
      break;  // the server has had enough
    }
    sent += static_cast<std::size_t>(count);
  }
  ::shutdown(client, SHUT_WR);
  std::array<std::uint8_t, 4096> reply;
  for (;;) {
    pollfd wait{.fd = client, .events = POLLIN, .revents = 0};
    int ready = -1;
    while ((ready = ::poll(&wait, 1, 5000)) < 0 && errno == EINTR) {  // the fuzzer's own alarm
    }
    require(ready == 1, "the server closes a connection that its client closed");
    if (::recv(client, reply.data(), reply.size(), 0) <= 0) {
      break;
    }
  }
  ::close(client);
  const EmulatorReport report = server().report();
  for (const double current_mA : report.max_abs_current_mA) {
    require(std::isfinite(current_mA) && current_mA <= 10000.0, "a real motor's current");
  }
}

}  // namespace forcegrid::fuzz
