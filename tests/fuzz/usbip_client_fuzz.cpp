// SPDX-License-Identifier: Apache-2.0
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <memory>
#include <string>
#include <thread>

#include "driver/device.h"
#include "driver/device_url.h"
#include "driver/hid_descriptor.h"
#include "driver/usbip_transport.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

// Sends the same bytes to whoever connects, then says that it is done, and takes what it is sent.
class Speaker {
 public:
  explicit Speaker(Input words) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    require(::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                ::listen(listener_, 1) == 0 &&
                ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) == 0,
            "a port is free");
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this, words] { speak(words); });
  }
  ~Speaker() {
    thread_.join();
    ::close(listener_);
  }
  Speaker(const Speaker&) = delete;
  Speaker& operator=(const Speaker&) = delete;

  std::string url() const { return "usbip://127.0.0.1:" + std::to_string(port_) + "/1-1"; }

 private:
  void speak(Input words) const {
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    // No reset by the close, however many bytes stay unread.
    const linger at_once{1, 0};
    ::setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    while (!words.empty()) {
      const ssize_t sent = ::send(client, words.data(), words.size(), MSG_NOSIGNAL);
      if (sent <= 0) {
        break;
      }
      words = words.subspan(static_cast<std::size_t>(sent));
    }
    ::shutdown(client, SHUT_WR);
    std::array<std::uint8_t, 4096> heard;
    while (::recv(client, heard.data(), heard.size(), 0) > 0) {
    }
    ::close(client);
  }

  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::thread thread_;
};

}  // namespace

void usbip_client(Input input) {
  using namespace std::chrono_literals;
  const Speaker server(input);
  try {
    const auto transport =
        driver::open_usbip_transport(driver::parse_device_url(server.url()), 500ms);
    driver::parse_hid_descriptor(transport->report_descriptor());
    std::array<std::uint8_t, 64> report{};
    for (int i = 0; i < 8; ++i) {
      const auto written = transport->write(std::span(report).first(14), 5ms);
      const auto read = transport->read(report, 1ms);
      if (written.status != driver::TransportStatus::kOk &&
          read.status != driver::TransportStatus::kOk) {
        break;
      }
    }
    transport->close();
    require(!transport->failure().empty(), "a closed transport says why");
  } catch (const driver::DeviceError& error) {
    require(error.what()[0] != '\0', "a refusal says why");
  }
}

}  // namespace forcegrid::fuzz
