// SPDX-License-Identifier: Apache-2.0
#include "driver/usbip_transport.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>

#include "driver/device.h"
#include "driver/usb_descriptors.h"
#include "driver/usbip_socket.h"
#include "driver/usbip_wire.h"

namespace forcegrid::driver {
namespace {

constexpr std::size_t kMaxTransferBytes = 4096;

constexpr std::size_t kMaxReportBytes = 64;
constexpr std::size_t kReportQueue = 32;
constexpr rt::Duration kSendTimeout = std::chrono::milliseconds(50);
// A server that the machine holds up for a while is not gone; the servo notices silence by itself.
constexpr rt::Duration kUnlinkTimeout = std::chrono::milliseconds(500);

constexpr std::uint32_t kRefusedStatus = 1;
constexpr std::uint32_t kBusyStatus = 2;

std::string import_error_words(std::uint32_t status) {
  switch (status) {
    case kRefusedStatus:
      return "the server refuses the device; it is in use, or not exported (`usbip bind`)";
    case kBusyStatus:
      return "the device is busy; end the other client that uses it";
    case 3:
      return "the device is in an error state; plug it in again at the server";
    case 4:
      return "the server has no such device; list its devices with `usbip list -r HOST`";
    default:
      return "the server refuses the device with status " + std::to_string(status) +
             "; look into the server's log";
  }
}

std::string usb_error_words(std::int32_t status) {
  return std::string(std::strerror(status < 0 ? -status : status)) + " (USB status " +
         std::to_string(status) + ")";
}

/// Whether a transfer's status means that the device is gone (unplug shows as bus errors first).
bool means_gone(std::int32_t status) noexcept {
  return status == -ENODEV || status == -ESHUTDOWN || status == -EPROTO || status == -EILSEQ ||
         status == -ETIME || status == -ENOENT || status == -ECONNRESET;
}

class UsbipTransport final : public BulkTransport {
 public:
  UsbipTransport(const DeviceUrl& url, rt::Duration timeout, InterfaceKind kind)
      : url_(url), kind_(kind), socket_(connect_to(url, rt::Clock::now() + timeout)) {
    import(rt::Clock::now() + timeout);
    enumerate(timeout);
    if (!submit_in()) {
      throw DeviceError(failure_);
    }
  }

  ~UsbipTransport() override { close(); }

  const TransportIdentity& identity() const noexcept override { return identity_; }
  const std::vector<std::uint8_t>& report_descriptor() const noexcept override {
    return report_descriptor_;
  }
  const std::string& failure() const noexcept override { return failure_; }

  ReadResult read(std::span<std::uint8_t> buffer, rt::Duration timeout) noexcept override {
    const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
    // Reports that arrived before a failure are still handed out.
    pump(deadline, [this] { return queue_size_ > 0 || reading_ != TransportStatus::kOk; });
    if (queue_size_ == 0) {
      const TransportStatus status = status_ != TransportStatus::kOk ? status_ : reading_;
      return {.status = status == TransportStatus::kOk ? TransportStatus::kTimeout : status};
    }
    const QueuedReport& report = queue_[queue_head_];
    std::memcpy(buffer.data(), report.bytes.data(), std::min(buffer.size(), report.size));
    const ReadResult result{
        .status = TransportStatus::kOk, .bytes = report.size, .arrived = report.arrived};
    queue_head_ = (queue_head_ + 1) % kReportQueue;
    --queue_size_;
    if (!in_.active && !closing_ && status_ == TransportStatus::kOk &&
        reading_ == TransportStatus::kOk) {
      submit_in();
    }
    return result;
  }

  bool can_wait() const noexcept override { return true; }

  WaitEnd wait(int descriptor, rt::Duration timeout) noexcept override {
    const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
    for (;;) {
      pump(rt::TimePoint{}, [this] { return queue_size_ > 0; });
      if (queue_size_ > 0 || status_ != TransportStatus::kOk || reading_ != TransportStatus::kOk) {
        return WaitEnd::kReport;
      }
      switch (wait_either(socket_.get(), POLLIN, descriptor, deadline)) {
        case Ready::kSocket:
          break;
        case Ready::kOther:
          return WaitEnd::kOther;
        case Ready::kTimeout:
          return WaitEnd::kTimeout;
      }
    }
  }

  WriteResult write(std::span<const std::uint8_t> report, rt::Duration timeout) noexcept override {
    if (status_ == TransportStatus::kProtocol && socket_.get() >= 0 &&
        report.size() <= kMaxReportBytes) {
      // The replies can no longer be understood, but the server still understands requests: a last
      // zero must not be lost because nothing confirms it.
      static_cast<void>(submit(out_, endpoints_.out_endpoint, false, report.size(),
                               endpoints_.out_interval, {}, report));
    }
    if (status_ != TransportStatus::kOk) {
      return {.status = status_};
    }
    const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
    if (report.size() > kMaxReportBytes) {
      fail(TransportStatus::kProtocol, "a report of more than 64 bytes was to be sent");
      return {.status = status_};
    }
    if (!submit(out_, endpoints_.out_endpoint, false, report.size(), endpoints_.out_interval, {},
                report)) {
      return {.status = status_};
    }
    pump(deadline, [this] { return !out_.active; });
    const bool withdrawal_tried = out_.active && status_ == TransportStatus::kOk;
    if (withdrawal_tried) {
      withdraw(out_, std::max(timeout, kUnlinkTimeout));
    }
    if (status_ != TransportStatus::kOk) {
      return {.status = status_};
    }
    const bool cancelled = out_.status == -ECONNRESET || out_.status == -ENOENT;
    if (out_.withdrawn || (withdrawal_tried && cancelled)) {
      return {.status = TransportStatus::kTimeout};
    }
    if (out_.status != 0) {
      fail(means_gone(out_.status) ? TransportStatus::kDisconnected : TransportStatus::kProtocol,
           "a report could not be sent: " + usb_error_words(out_.status));
      return {.status = status_};
    }
    return {.status = TransportStatus::kOk, .completed = out_.completed};
  }

  TransportStatus control_out(const ControlRequest& request,
                              rt::Duration timeout) noexcept override {
    if (status_ != TransportStatus::kOk) {
      return status_;
    }
    const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
    if (!exchange_control(request.request_type, request.request, request.value, request.index, 0,
                          deadline)) {
      if (status_ == TransportStatus::kOk) {
        withdraw(control_, std::max(timeout, kUnlinkTimeout));
      }
      return status_ == TransportStatus::kOk ? TransportStatus::kTimeout : status_;
    }
    if (control_.status != 0) {
      fail(
          means_gone(control_.status) ? TransportStatus::kDisconnected : TransportStatus::kProtocol,
          "it refuses control request " + std::to_string(request.request) + ": " +
              usb_error_words(control_.status));
    }
    return status_;
  }

  void close() noexcept override {
    if (socket_.get() < 0) {
      return;
    }
    closing_ = true;
    if (status_ == TransportStatus::kOk && in_.active) {
      withdraw(in_, kUnlinkTimeout);
    }
    ::shutdown(socket_.get(), SHUT_RDWR);
    socket_.close();
    if (status_ == TransportStatus::kOk) {
      status_ = TransportStatus::kDisconnected;
      failure_ = "device '" + url_.text + "': closed; open it again";
    }
  }

 private:
  /// One request that the server has to answer.
  struct Request {
    std::uint32_t sequence = 0;
    std::uint32_t endpoint = 0;
    std::uint32_t length = 0;
    bool direction_in = false;
    bool active = false;
    bool withdrawn = false;
    std::int32_t status = 0;
    std::uint32_t actual_length = 0;
    rt::TimePoint completed{};
  };

  struct QueuedReport {
    std::array<std::uint8_t, kMaxReportBytes> bytes{};
    std::size_t size = 0;
    rt::TimePoint arrived{};
  };

  void fail(TransportStatus status, const std::string& problem) {
    if (status_ != TransportStatus::kOk) {
      return;  // the first reason is the one that matters
    }
    status_ = status;
    if (reading_ == TransportStatus::kOk) {
      say(status, problem);
    }
  }

  /// No more reports come, but the connection stands and reports can still be sent.
  void fail_reading(TransportStatus status, const std::string& problem) {
    if (status_ == TransportStatus::kOk && reading_ == TransportStatus::kOk) {
      reading_ = status;
      say(status, problem);
    }
  }

  void say(TransportStatus status, const std::string& problem) {
    failure_ = "device '" + url_.text + "': " + problem +
               (status == TransportStatus::kDisconnected
                    ? "; check the device and its server, then open it again"
                    : "; update the USB/IP server or use another one");
  }

  /// Sending and receiving may both find the closed connection first; the words are the same.
  static std::string why_no_more(const char* doing) {
    return errno == EPIPE || errno == ECONNRESET
               ? "the server closed the connection"
               : doing + (": " + std::string(std::strerror(errno)));
  }

  bool send_all(std::span<const std::uint8_t> bytes, rt::TimePoint deadline) noexcept {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent > 0) {
        bytes = bytes.subspan(static_cast<std::size_t>(sent));
      } else if (sent < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
        if (!wait_ready(socket_.get(), POLLOUT, deadline)) {
          fail(TransportStatus::kDisconnected, "the server does not take what is sent");
          return false;
        }
      } else if (sent >= 0 || errno != EINTR) {
        fail(TransportStatus::kDisconnected, why_no_more("send"));
        return false;
      }
    }
    return true;
  }

  /// Receives exactly `bytes`; for the import, before requests are pending.
  bool receive_all(std::span<std::uint8_t> bytes, rt::TimePoint deadline) {
    while (!bytes.empty()) {
      const ssize_t count = ::recv(socket_.get(), bytes.data(), bytes.size(), 0);
      if (count > 0) {
        bytes = bytes.subspan(static_cast<std::size_t>(count));
      } else if (count == 0) {
        fail(TransportStatus::kDisconnected, "the server closed the connection");
        return false;
      } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
        if (!wait_ready(socket_.get(), POLLIN, deadline)) {
          fail(TransportStatus::kDisconnected, "the server does not answer");
          return false;
        }
      } else if (errno != EINTR) {
        fail(TransportStatus::kDisconnected, why_no_more("receive"));
        return false;
      }
    }
    return true;
  }

  void import(rt::TimePoint deadline) {
    std::array<std::uint8_t, usbip::kOperationHeaderBytes> reply{};
    std::array<std::uint8_t, usbip::kImportedDeviceBytes> bytes{};
    if (!send_all(usbip::import_request(url_.bus_id), deadline) || !receive_all(reply, deadline)) {
      throw DeviceError(failure_);
    }
    if (!usbip::is_import_reply(reply)) {
      fail_open(url_,
                "what answers there does not speak USB/IP 1.1.1; correct host and port, or update "
                "the server");
    }
    if (const std::uint32_t status = usbip::import_status(reply); status != 0) {
      if (status == kRefusedStatus || status == kBusyStatus) {
        throw DeviceInUse("device '" + url_.text + "': " + import_error_words(status));
      }
      fail_open(url_, import_error_words(status));
    }
    if (!receive_all(bytes, deadline)) {
      throw DeviceError(failure_);
    }
    const usbip::ImportedDevice device = usbip::imported_device(bytes);
    std::array<char, usbip::kBusIdBytes> bus_id{};
    std::memcpy(bus_id.data(), url_.bus_id.data(), url_.bus_id.size());
    if (bus_id != device.bus_id) {
      fail_open(url_, "the server answers with another device; update the server");
    }
    device_id_ = device.device_id;
    identity_.vendor_id = device.vendor_id;
    identity_.product_id = device.product_id;
  }

  bool submit(Request& request, std::uint32_t endpoint, bool direction_in, std::size_t length,
              std::uint32_t interval, const std::array<std::uint8_t, 8>& setup,
              std::span<const std::uint8_t> payload) noexcept {
    request = Request{.sequence = ++sequence_,
                      .endpoint = endpoint,
                      .length = static_cast<std::uint32_t>(length),
                      .direction_in = direction_in,
                      .active = true};
    std::array<std::uint8_t, usbip::kHeaderBytes + kMaxReportBytes> message{};
    usbip::put_submit(std::span(message).first<usbip::kHeaderBytes>(), command_for(request),
                      request.length, interval, setup);
    std::copy(payload.begin(), payload.end(), message.begin() + usbip::kHeaderBytes);
    return send_all({message.data(), usbip::kHeaderBytes + payload.size()},
                    rt::Clock::now() + kSendTimeout);
  }

  usbip::Command command_for(const Request& request) const noexcept {
    return {.sequence = request.sequence,
            .device_id = device_id_,
            .direction_in = request.direction_in,
            .endpoint = request.endpoint};
  }

  bool submit_in() noexcept {
    return submit(in_, endpoints_.in_endpoint, true, endpoints_.in_bytes, endpoints_.in_interval,
                  {}, {});
  }

  /// UNLINK of `request`. Afterwards it is not active: answered, withdrawn, or the transport
  /// failed.
  void withdraw(Request& request, rt::Duration timeout) noexcept {
    unlink_ = Request{.sequence = ++sequence_, .active = true};
    std::array<std::uint8_t, usbip::kHeaderBytes> message{};
    usbip::Command command = command_for(request);
    command.sequence = unlink_.sequence;
    usbip::put_unlink(message, command, request.sequence);
    const rt::TimePoint deadline = rt::Clock::now() + timeout;
    if (!send_all(message, deadline)) {
      return;
    }
    pump(deadline, [this] { return !unlink_.active; });
    if (unlink_.active) {
      fail(TransportStatus::kDisconnected, "the server does not answer");
    } else if (request.active) {
      request.active = false;
      request.withdrawn = true;
    }
  }

  /// Handles what the server sends until `done()`, a failure, or `deadline`; at least what is
  /// there.
  template <typename Done>
  void pump(rt::TimePoint deadline, Done done) noexcept {
    for (bool looked = false;; looked = true) {
      while (status_ == TransportStatus::kOk && handle_one_message()) {
      }
      // A server that never stops sending must not outlast the deadline.
      if (done() || status_ != TransportStatus::kOk || (looked && rt::Clock::now() >= deadline)) {
        return;
      }
      const ssize_t count = ::recv(socket_.get(), received_.data() + received_size_,
                                   received_.size() - received_size_, 0);
      if (count > 0) {
        received_size_ += static_cast<std::size_t>(count);
        received_at_ = rt::Clock::now();
      } else if (count == 0) {
        fail(TransportStatus::kDisconnected, "the server closed the connection");
      } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
        if (!wait_ready(socket_.get(), POLLIN, deadline)) {
          return;
        }
      } else if (errno != EINTR) {
        fail(TransportStatus::kDisconnected, why_no_more("receive"));
      }
    }
  }

  /// @returns false when no whole message is in the buffer, or on a failure.
  bool handle_one_message() noexcept {
    if (received_size_ < usbip::kHeaderBytes) {
      return false;
    }
    const usbip::Reply reply = usbip::reply(std::span(received_).first<usbip::kHeaderBytes>());
    if (reply.command == usbip::kUnlinkReply) {
      if (!unlink_.active || unlink_.sequence != reply.sequence) {
        fail(TransportStatus::kProtocol, "the server answers a withdrawal that was not asked for");
        return false;
      }
      unlink_.active = false;
      consume(usbip::kHeaderBytes);
      return true;
    }
    if (reply.command != usbip::kSubmitReply) {
      fail(TransportStatus::kProtocol,
           "the server sends message type " + std::to_string(reply.command) + ", which is unknown");
      return false;
    }
    Request* const request = pending(reply.sequence);
    if (request == nullptr) {
      fail(TransportStatus::kProtocol, "the server answers request " +
                                           std::to_string(reply.sequence) +
                                           ", which is not pending");
      return false;
    }
    const std::uint32_t length = reply.actual_length;
    if (length > request->length) {
      fail(TransportStatus::kProtocol, "the server answers with " + std::to_string(length) +
                                           " bytes where at most " +
                                           std::to_string(request->length) + " were asked for");
      return false;
    }
    const std::size_t payload = request->direction_in ? length : 0;
    if (received_size_ < usbip::kHeaderBytes + payload) {
      return false;
    }
    request->active = false;
    request->status = reply.status;
    request->actual_length = length;
    request->completed = received_at_;
    if (request == &control_) {
      std::memcpy(control_data_.data(), received_.data() + usbip::kHeaderBytes, payload);
    } else if (request == &in_) {
      take_report({received_.data() + usbip::kHeaderBytes, payload}, reply.status);
    }
    consume(usbip::kHeaderBytes + payload);
    return status_ == TransportStatus::kOk;
  }

  Request* pending(std::uint32_t sequence) noexcept {
    for (Request* request : {&in_, &out_, &control_}) {
      if (request->active && request->sequence == sequence) {
        return request;
      }
    }
    return nullptr;
  }

  void take_report(std::span<const std::uint8_t> bytes, std::int32_t status) noexcept {
    if (status != 0) {
      if (!closing_) {
        fail_reading(
            means_gone(status) ? TransportStatus::kDisconnected : TransportStatus::kProtocol,
            "no more reports: " + usb_error_words(status));
      }
      return;
    }
    if (queue_size_ == kReportQueue) {  // the newest reports are the ones that count
      queue_head_ = (queue_head_ + 1) % kReportQueue;
      --queue_size_;
    }
    QueuedReport& report = queue_[(queue_head_ + queue_size_) % kReportQueue];
    std::copy(bytes.begin(), bytes.end(), report.bytes.begin());
    report.size = bytes.size();
    report.arrived = received_at_;
    ++queue_size_;
    // Bulk data are a stream, of which nothing may be lost: a full queue makes the device wait.
    if (!closing_ && (kind_ == InterfaceKind::kHid || queue_size_ < kReportQueue)) {
      submit_in();
    }
  }

  void consume(std::size_t bytes) noexcept {
    std::memmove(received_.data(), received_.data() + bytes, received_size_ - bytes);
    received_size_ -= bytes;
  }

  /// A control transfer on endpoint 0.
  /// @returns false when it was not answered by `deadline`, or the transport failed; else
  ///          control_.status is the USB status and control_data_ has the data of an IN transfer.
  bool exchange_control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                        std::uint16_t index, std::uint16_t length,
                        rt::TimePoint deadline) noexcept {
    const std::array<std::uint8_t, 8> setup = {request_type,
                                               request,
                                               static_cast<std::uint8_t>(value & 0xFF),
                                               static_cast<std::uint8_t>(value >> 8),
                                               static_cast<std::uint8_t>(index & 0xFF),
                                               static_cast<std::uint8_t>(index >> 8),
                                               static_cast<std::uint8_t>(length & 0xFF),
                                               static_cast<std::uint8_t>(length >> 8)};
    if (!submit(control_, 0, (request_type & 0x80) != 0, length, 0, setup, {})) {
      return false;
    }
    pump(deadline, [this] { return !control_.active; });
    return status_ == TransportStatus::kOk && !control_.active;
  }

  /// The same while opening.
  /// @returns the USB status.
  std::int32_t control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                       std::uint16_t index, std::uint16_t length, rt::Duration timeout) {
    if (!exchange_control(request_type, request, value, index, length,
                          rt::Clock::now() + timeout)) {
      fail(TransportStatus::kDisconnected, "the device does not answer a control request");
      throw DeviceError(failure_);
    }
    return control_.status;
  }

  std::vector<std::uint8_t> descriptor(std::uint8_t request_type, std::uint8_t type,
                                       std::uint8_t number, std::uint16_t index,
                                       std::uint16_t length, rt::Duration timeout,
                                       const char* name) {
    constexpr std::uint8_t kGetDescriptor = 6;
    const std::int32_t status =
        control(request_type, kGetDescriptor, static_cast<std::uint16_t>((type << 8) | number),
                index, length, timeout);
    if (status != 0) {
      fail_open(url_, std::string("the device refuses its ") + name + ": " +
                          usb_error_words(status) + "; plug it in again");
    }
    return {control_data_.begin(), control_data_.begin() + control_.actual_length};
  }

  std::string string_descriptor(std::uint8_t number, std::uint16_t language, rt::Duration timeout) {
    if (number == 0) {
      return "";
    }
    const auto bytes =
        descriptor(0x80, kStringDescriptor, number, language, 255, timeout, "string descriptor");
    if (bytes.size() < 2 || bytes[1] != kStringDescriptor || bytes[0] > bytes.size() ||
        bytes[0] < 2) {
      fail_open(url_, "its string descriptor " + std::to_string(number) +
                          " is malformed; this is not a device of the profile");
    }
    return utf8_of({bytes.data() + 2, static_cast<std::size_t>(bytes[0]) - 2});
  }

  void enumerate(rt::Duration timeout) {
    constexpr std::uint8_t kSetConfiguration = 9;
    constexpr std::uint8_t kSetIdle = 10;
    const auto device = descriptor(0x80, kDeviceDescriptor, 0, 0, 18, timeout, "device descriptor");
    if (device.size() != 18 || device[0] != 18 || device[1] != kDeviceDescriptor) {
      fail_open(url_, "its device descriptor is malformed; this is not a device of the profile");
    }
    identity_.vendor_id = little16(&device[8]);
    identity_.product_id = little16(&device[10]);

    auto configuration =
        descriptor(0x80, kConfigurationDescriptor, 0, 0, 9, timeout, "configuration descriptor");
    if (configuration.size() == 9 && configuration[1] == kConfigurationDescriptor) {
      const std::size_t total = little16(&configuration[2]);
      if (total >= 9 && total <= kMaxTransferBytes) {
        configuration =
            descriptor(0x80, kConfigurationDescriptor, 0, 0, static_cast<std::uint16_t>(total),
                       timeout, "configuration descriptor");
      }
    }
    const bool hid = kind_ == InterfaceKind::kHid;
    const auto found = find_interface(configuration, kind_);
    if (!found || found->in_bytes == 0 || found->in_bytes > kMaxReportBytes ||
        found->report_descriptor_bytes > kMaxTransferBytes) {
      fail_open(url_,
                std::string(hid ? "it has no HID interface with an interrupt endpoint"
                                : "it has no vendor-specific interface with a bulk endpoint") +
                    " of 1 to 64 bytes each way; this is not a device of the profile");
    }
    endpoints_ = *found;

    std::uint16_t language = 0x0409;
    const auto languages =
        descriptor(0x80, kStringDescriptor, 0, 0, 255, timeout, "string descriptor");
    if (languages.size() >= 4) {
      language = little16(&languages[2]);
    }
    identity_.manufacturer = string_descriptor(device[14], language, timeout);
    identity_.product = string_descriptor(device[15], language, timeout);
    identity_.serial = string_descriptor(device[16], language, timeout);

    if (const std::int32_t status =
            control(0x00, kSetConfiguration, endpoints_.configuration, 0, 0, timeout);
        status != 0) {
      fail_open(url_, "the device refuses its configuration: " + usb_error_words(status) +
                          "; plug it in again");
    }
    if (!hid) {
      return;
    }
    // A device need not have an idle rate: its refusal (a stall) is of no consequence.
    static_cast<void>(control(0x21, kSetIdle, 0, endpoints_.interface, 0, timeout));
    report_descriptor_ =
        descriptor(0x81, kReportDescriptor, 0, endpoints_.interface,
                   endpoints_.report_descriptor_bytes, timeout, "report descriptor");
  }

  DeviceUrl url_;
  InterfaceKind kind_;
  Socket socket_;
  TransportIdentity identity_;
  std::vector<std::uint8_t> report_descriptor_;
  Endpoints endpoints_;
  std::uint32_t device_id_ = 0;
  std::uint32_t sequence_ = 0;
  bool closing_ = false;
  TransportStatus status_ = TransportStatus::kOk;
  TransportStatus reading_ = TransportStatus::kOk;  ///< of the IN endpoint alone
  std::string failure_;

  Request control_;
  Request in_;
  Request out_;
  Request unlink_;
  std::array<std::uint8_t, kMaxTransferBytes> control_data_{};

  std::array<std::uint8_t, 2 * (usbip::kHeaderBytes + kMaxTransferBytes)> received_{};
  std::size_t received_size_ = 0;
  rt::TimePoint received_at_{};

  std::array<QueuedReport, kReportQueue> queue_{};
  std::size_t queue_head_ = 0;
  std::size_t queue_size_ = 0;
};

}  // namespace

std::unique_ptr<Transport> open_usbip_transport(const DeviceUrl& url, rt::Duration timeout) {
  return std::make_unique<UsbipTransport>(url, timeout, InterfaceKind::kHid);
}

std::unique_ptr<BulkTransport> open_usbip_bulk_transport(const DeviceUrl& url,
                                                         rt::Duration timeout) {
  return std::make_unique<UsbipTransport>(url, timeout, InterfaceKind::kVendor);
}

}  // namespace forcegrid::driver
