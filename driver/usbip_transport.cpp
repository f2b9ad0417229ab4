#include "driver/usbip_transport.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

constexpr std::uint16_t kProtocolVersion = 0x0111;
constexpr std::uint16_t kImportRequest = 0x8003;
constexpr std::uint16_t kImportReply = 0x0003;
constexpr std::size_t kBusIdBytes = 32;
constexpr std::size_t kOperationHeaderBytes = 8;
constexpr std::size_t kImportedDeviceBytes = 312;
constexpr std::size_t kBusIdOffset = 256;
constexpr std::size_t kNumbersOffset = 288;  // busnum, devnum, speed, then the descriptor's ids

constexpr std::uint32_t kSubmit = 1;
constexpr std::uint32_t kUnlink = 2;
constexpr std::uint32_t kSubmitReply = 3;
constexpr std::uint32_t kUnlinkReply = 4;
constexpr std::size_t kHeaderBytes = 48;
constexpr std::size_t kMaxTransferBytes = 4096;
constexpr std::uint32_t kFlagDirectionIn = 0x0200;

constexpr std::size_t kMaxReportBytes = 64;
constexpr std::size_t kReportQueue = 32;
constexpr rt::Duration kSendTimeout = std::chrono::milliseconds(50);
constexpr rt::Duration kUnlinkTimeout = std::chrono::milliseconds(50);

constexpr std::uint8_t kDeviceDescriptor = 1;
constexpr std::uint8_t kConfigurationDescriptor = 2;
constexpr std::uint8_t kStringDescriptor = 3;
constexpr std::uint8_t kInterfaceDescriptor = 4;
constexpr std::uint8_t kEndpointDescriptor = 5;
constexpr std::uint8_t kHidDescriptor = 0x21;
constexpr std::uint8_t kReportDescriptor = 0x22;
constexpr std::uint8_t kHidClass = 3;
constexpr std::uint8_t kVendorClass = 0xFF;
constexpr std::uint8_t kBulk = 2;
constexpr std::uint8_t kInterrupt = 3;

std::uint16_t get16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::uint16_t>((bytes[0] << 8) | bytes[1]);
}
std::uint32_t get32(const std::uint8_t* bytes) noexcept {
  return (static_cast<std::uint32_t>(get16(bytes)) << 16) | get16(bytes + 2);
}
void put16(std::uint8_t* bytes, std::uint16_t value) noexcept {
  bytes[0] = static_cast<std::uint8_t>(value >> 8);
  bytes[1] = static_cast<std::uint8_t>(value & 0xFF);
}
void put32(std::uint8_t* bytes, std::uint32_t value) noexcept {
  put16(bytes, static_cast<std::uint16_t>(value >> 16));
  put16(bytes + 2, static_cast<std::uint16_t>(value & 0xFFFF));
}
std::uint16_t little16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8));
}

enum class Ready : std::uint8_t { kSocket, kOther, kTimeout };

/// Waits until `socket` is ready for `events`, `other` (unless negative) can be read, or
/// `deadline`.
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

/// @returns false at `deadline`.
bool wait_ready(int socket, short events, rt::TimePoint deadline) noexcept {
  return wait_either(socket, events, -1, deadline) == Ready::kSocket;
}

/// A socket that closes itself.
class Socket {
 public:
  Socket() = default;
  explicit Socket(int descriptor) : descriptor_(descriptor) {}
  Socket(Socket&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~Socket() { close(); }
  void close() noexcept {
    if (descriptor_ >= 0) {
      ::close(descriptor_);
      descriptor_ = -1;
    }
  }
  int get() const noexcept { return descriptor_; }

 private:
  int descriptor_ = -1;
};

[[noreturn]] void fail_open(const DeviceUrl& url, const std::string& problem) {
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

std::string import_error_words(std::uint32_t status) {
  switch (status) {
    case 1:
      return "the server refuses the device; it is in use, or not exported (`usbip bind`)";
    case 2:
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

std::string utf8_of(std::span<const std::uint8_t> utf16) {
  std::string text;
  for (std::size_t i = 0; i + 1 < utf16.size(); i += 2) {
    const unsigned unit = little16(&utf16[i]);
    if (unit >= 0xD800 && unit < 0xE000) {
      text += '?';  // no device of this family has characters beyond the basic plane
    } else if (unit < 0x80) {
      text += unit < 0x20 ? '?' : static_cast<char>(unit);
    } else if (unit < 0x800) {
      text += static_cast<char>(0xC0 | (unit >> 6));
      text += static_cast<char>(0x80 | (unit & 0x3F));
    } else {
      text += static_cast<char>(0xE0 | (unit >> 12));
      text += static_cast<char>(0x80 | ((unit >> 6) & 0x3F));
      text += static_cast<char>(0x80 | (unit & 0x3F));
    }
  }
  return text;
}

/// What the driver wants of a device.
enum class InterfaceKind : std::uint8_t { kHid, kVendor };

struct Endpoints {
  std::uint8_t configuration = 0;
  std::uint8_t interface = 0;
  std::uint16_t report_descriptor_bytes = 0;
  std::uint8_t in_endpoint = 0;
  std::uint8_t out_endpoint = 0;
  std::uint16_t in_bytes = 0;
  std::uint8_t in_interval = 1;
  std::uint8_t out_interval = 1;
};

/// In a configuration descriptor, the first HID interface that has an interrupt endpoint each way,
/// or the first vendor-specific one with a bulk endpoint each way.
std::optional<Endpoints> find_interface(std::span<const std::uint8_t> bytes, InterfaceKind kind) {
  const bool hid = kind == InterfaceKind::kHid;
  if (bytes.size() < 9) {
    return std::nullopt;
  }
  Endpoints candidate;
  bool is_wanted = false;
  std::size_t at = 0;
  while (bytes.size() - at >= 2) {
    const std::size_t length = bytes[at];
    if (length < 2 || length > bytes.size() - at) {
      return std::nullopt;
    }
    const auto item = bytes.subspan(at, length);
    if (item[1] == kInterfaceDescriptor && length >= 9) {
      candidate = Endpoints{.configuration = bytes[5], .interface = item[2]};
      is_wanted = item[5] == (hid ? kHidClass : kVendorClass) && item[3] == 0;
    } else if (hid && is_wanted && item[1] == kHidDescriptor && length >= 9 &&
               item[6] == kReportDescriptor) {
      candidate.report_descriptor_bytes = little16(&item[7]);
    } else if (is_wanted && item[1] == kEndpointDescriptor && length >= 7 &&
               (item[3] & 3) == (hid ? kInterrupt : kBulk)) {
      const auto packet_bytes = static_cast<std::uint16_t>(little16(&item[4]) & 0x7FF);
      if ((item[2] & 0x80) != 0 && candidate.in_endpoint == 0) {
        candidate.in_endpoint = item[2] & 0x0F;
        candidate.in_bytes = packet_bytes;
        candidate.in_interval = item[6];
      } else if ((item[2] & 0x80) == 0 && candidate.out_endpoint == 0) {
        candidate.out_endpoint = item[2] & 0x0F;
        candidate.out_interval = item[6];
      }
    }
    if (is_wanted && candidate.in_endpoint != 0 && candidate.out_endpoint != 0 &&
        (!hid || candidate.report_descriptor_bytes != 0)) {
      return candidate;
    }
    at += length;
  }
  return std::nullopt;
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
      // What comes in can't be understood any more, but what goes out still can: a last zero must
      // not be lost for want of a confirmation.
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

  /// Whether it is seen first on the way there or on the way back is chance.
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
    std::array<std::uint8_t, kOperationHeaderBytes + kBusIdBytes> request{};
    put16(request.data(), kProtocolVersion);
    put16(request.data() + 2, kImportRequest);
    std::memcpy(request.data() + kOperationHeaderBytes, url_.bus_id.data(), url_.bus_id.size());
    std::array<std::uint8_t, kOperationHeaderBytes> reply{};
    std::array<std::uint8_t, kImportedDeviceBytes> device{};
    if (!send_all(request, deadline) || !receive_all(reply, deadline)) {
      throw DeviceError(failure_);
    }
    if (get16(reply.data()) != kProtocolVersion || get16(reply.data() + 2) != kImportReply) {
      fail_open(url_,
                "what answers there does not speak USB/IP 1.1.1; correct host and port, or update "
                "the server");
    }
    if (const std::uint32_t status = get32(reply.data() + 4); status != 0) {
      fail_open(url_, import_error_words(status));
    }
    if (!receive_all(device, deadline)) {
      throw DeviceError(failure_);
    }
    std::array<std::uint8_t, kBusIdBytes> bus_id{};
    std::memcpy(bus_id.data(), url_.bus_id.data(), url_.bus_id.size());
    if (!std::equal(bus_id.begin(), bus_id.end(), device.begin() + kBusIdOffset)) {
      fail_open(url_, "the server answers with another device; update the server");
    }
    const std::uint8_t* numbers = device.data() + kNumbersOffset;
    device_id_ = (get32(numbers) << 16) | (get32(numbers + 4) & 0xFFFF);
    identity_.vendor_id = get16(numbers + 12);
    identity_.product_id = get16(numbers + 14);
  }

  bool submit(Request& request, std::uint32_t endpoint, bool direction_in, std::size_t length,
              std::uint32_t interval, const std::array<std::uint8_t, 8>& setup,
              std::span<const std::uint8_t> payload) noexcept {
    request = Request{.sequence = ++sequence_,
                      .endpoint = endpoint,
                      .length = static_cast<std::uint32_t>(length),
                      .direction_in = direction_in,
                      .active = true};
    std::array<std::uint8_t, kHeaderBytes + kMaxReportBytes> message{};
    put_basic_header(message, kSubmit, request.sequence, direction_in, endpoint);
    put32(&message[20], direction_in ? kFlagDirectionIn : 0);
    put32(&message[24], request.length);
    put32(&message[36], interval);
    std::copy(setup.begin(), setup.end(), message.begin() + 40);
    std::copy(payload.begin(), payload.end(), message.begin() + kHeaderBytes);
    return send_all({message.data(), kHeaderBytes + payload.size()},
                    rt::Clock::now() + kSendTimeout);
  }

  void put_basic_header(std::span<std::uint8_t> message, std::uint32_t command,
                        std::uint32_t sequence, bool direction_in,
                        std::uint32_t endpoint) const noexcept {
    put32(&message[0], command);
    put32(&message[4], sequence);
    put32(&message[8], device_id_);
    put32(&message[12], direction_in ? 1 : 0);
    put32(&message[16], endpoint);
  }

  bool submit_in() noexcept {
    return submit(in_, endpoints_.in_endpoint, true, endpoints_.in_bytes, endpoints_.in_interval,
                  {}, {});
  }

  /// UNLINK of `request`. Afterwards it is not active: answered, withdrawn, or the transport
  /// failed.
  void withdraw(Request& request, rt::Duration timeout) noexcept {
    unlink_ = Request{.sequence = ++sequence_, .active = true};
    std::array<std::uint8_t, kHeaderBytes> message{};
    put_basic_header(message, kUnlink, unlink_.sequence, request.direction_in, request.endpoint);
    put32(&message[20], request.sequence);
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
    if (received_size_ < kHeaderBytes) {
      return false;
    }
    const std::uint32_t command = get32(&received_[0]);
    const std::uint32_t sequence = get32(&received_[4]);
    const auto status = static_cast<std::int32_t>(get32(&received_[20]));
    if (command == kUnlinkReply) {
      if (!unlink_.active || unlink_.sequence != sequence) {
        fail(TransportStatus::kProtocol, "the server answers a withdrawal that was not asked for");
        return false;
      }
      unlink_.active = false;
      consume(kHeaderBytes);
      return true;
    }
    if (command != kSubmitReply) {
      fail(TransportStatus::kProtocol,
           "the server sends message type " + std::to_string(command) + ", which is unknown");
      return false;
    }
    Request* const request = pending(sequence);
    if (request == nullptr) {
      fail(TransportStatus::kProtocol,
           "the server answers request " + std::to_string(sequence) + ", which is not pending");
      return false;
    }
    const std::uint32_t length = get32(&received_[24]);
    if (length > request->length) {
      fail(TransportStatus::kProtocol, "the server answers with " + std::to_string(length) +
                                           " bytes where at most " +
                                           std::to_string(request->length) + " were asked for");
      return false;
    }
    const std::size_t payload = request->direction_in ? length : 0;
    if (received_size_ < kHeaderBytes + payload) {
      return false;
    }
    request->active = false;
    request->status = status;
    request->actual_length = length;
    request->completed = received_at_;
    if (request == &control_) {
      std::memcpy(control_data_.data(), received_.data() + kHeaderBytes, payload);
    } else if (request == &in_) {
      take_report({received_.data() + kHeaderBytes, payload}, status);
    }
    consume(kHeaderBytes + payload);
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

  std::array<std::uint8_t, 2 * (kHeaderBytes + kMaxTransferBytes)> received_{};
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
