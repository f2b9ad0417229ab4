// SPDX-License-Identifier: Apache-2.0
#include "driver/hidraw_transport.h"

#include <hidapi.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>

#include "driver/device.h"
#include "driver/node_lock.h"
#include "driver/usb_presence.h"

namespace forcegrid::driver {
namespace {

constexpr std::size_t kMaxHidReportBytes = 64;

std::string narrow(const wchar_t* text) {
  std::string result;
  for (; text != nullptr && *text != L'\0'; ++text) {
    result += *text < 0x80 ? static_cast<char>(*text) : '?';
  }
  return result;
}

/// hidapi takes whole milliseconds and reads a negative number as "for ever".
int hidapi_timeout_ms(rt::Duration timeout) noexcept {
  const auto count = std::chrono::ceil<std::chrono::milliseconds>(timeout).count();
  return count < 0 ? 0 : (count > 60'000 ? 60'000 : static_cast<int>(count));
}

class HidrawTransport final : public Transport {
 public:
  HidrawTransport(const HidrawNode& node, bool share,
                  const std::function<void(const std::string&)>& notice)
      : node_(node.node),
        lock_(std::in_place, node.node, share, notice),
        port_path_(node.port_path),
        presence_(node.port_path, node.interface),
        identity_{node.vendor_id, node.product_id, node.manufacturer, node.product, node.serial},
        report_descriptor_(node.report_descriptor) {
    if (hid_init() != 0) {
      throw DeviceError("hidapi: can't start (" + narrow(hid_error(nullptr)) +
                        "); check that libhidapi-hidraw0 is installed");
    }
    errno = 0;
    device_ = hid_open_path(node_.c_str());
    if (device_ == nullptr) {
      const int reason = errno;
      throw DeviceError("open " + node_ + ": " +
                        (reason != 0 ? std::strerror(reason) : narrow(hid_error(nullptr)).c_str()) +
                        "; plug the device in again");
    }
  }

  ~HidrawTransport() override { close(); }

  const TransportIdentity& identity() const noexcept override { return identity_; }
  const std::vector<std::uint8_t>& report_descriptor() const noexcept override {
    return report_descriptor_;
  }
  const std::string& failure() const noexcept override { return failure_; }

  ReadResult read(std::span<std::uint8_t> buffer, rt::Duration timeout) noexcept override {
    if (device_ == nullptr) {
      return {.status = TransportStatus::kDisconnected};
    }
    const int count =
        hid_read_timeout(device_, buffer.data(), buffer.size(), hidapi_timeout_ms(timeout));
    if (count < 0) {
      return {.status = fail("read")};
    }
    if (count == 0) {
      return {.status = TransportStatus::kTimeout};
    }
    return {.status = TransportStatus::kOk,
            .bytes = static_cast<std::size_t>(count),
            .arrived = rt::Clock::now()};
  }

  // hidapi keeps its descriptor to itself, so nothing can be waited for beside it.
  bool can_wait() const noexcept override { return false; }
  WaitEnd wait(int, rt::Duration) noexcept override { return WaitEnd::kTimeout; }

  WriteResult write(std::span<const std::uint8_t> report, rt::Duration) noexcept override {
    std::array<std::uint8_t, kMaxHidReportBytes + 1> buffer{};  // the report ID slot stays zero
    if (device_ == nullptr) {
      return {.status = TransportStatus::kDisconnected};
    }
    if (report.size() > kMaxHidReportBytes) {
      failure_ = "write " + node_ + ": a report of more than 64 bytes; send the protocol's reports";
      return {.status = TransportStatus::kProtocol};
    }
    std::memcpy(buffer.data() + 1, report.data(), report.size());
    errno = 0;
    const int count = hid_write(device_, buffer.data(), report.size() + 1);
    if (count < 0 && errno == ETIMEDOUT) {
      return {.status = TransportStatus::kTimeout};
    }
    if (count < 0 && errno == EPIPE) {
      failure_ = "write " + node_ + ": the device refuses reports (STALL); plug it in again";
      return {.status = TransportStatus::kProtocol};
    }
    if (count != static_cast<int>(report.size() + 1)) {
      return {.status = fail("write")};
    }
    return {.status = TransportStatus::kOk, .completed = rt::Clock::now()};
  }

  void close() noexcept override {
    if (device_ != nullptr) {
      hid_close(device_);
      device_ = nullptr;
    }
    lock_.reset();
  }

 private:
  TransportStatus fail(const char* action) {
    const int reason = errno;
    if (const std::string driver = presence_.taken_by(); !driver.empty()) {
      failure_ =
          std::string(action) + " " + node_ + ": the device is still at USB port " + port_path_ +
          ", but " +
          (driver == "none" ? "no driver has its interface: another program detached it"
                            : "driver " + driver + " has its interface: another program took it") +
          "; end that program, then plug the device in again";
      return TransportStatus::kTaken;
    }
    failure_ = std::string(action) + " " + node_ + ": " +
               (reason != 0 ? std::strerror(reason) : narrow(hid_error(device_)).c_str()) +
               "; plug the device in again";
    return TransportStatus::kDisconnected;
  }

  std::string node_;
  std::optional<NodeLock> lock_;  ///< while the device is open
  std::string port_path_;
  UsbPresence presence_;
  TransportIdentity identity_;
  std::vector<std::uint8_t> report_descriptor_;
  std::string failure_;
  hid_device* device_ = nullptr;
};

}  // namespace

std::unique_ptr<Transport> open_hidraw_transport(
    const HidrawNode& node, bool share, const std::function<void(const std::string&)>& notice) {
  return std::make_unique<HidrawTransport>(node, share, notice);
}

}  // namespace forcegrid::driver
