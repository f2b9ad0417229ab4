#include "device_emulator/emulator_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <future>
#include <mutex>
#include <optional>
#include <span>
#include <utility>

#include "device_emulator/urb_host.h"
#include "device_emulator/usbip_wire.h"

namespace forcegrid::emulator {

namespace {

constexpr rt::Duration kIdleLimit = std::chrono::seconds(10);
constexpr std::size_t kMaxCommandsPerFrame = 64;
constexpr int kIdlePoll_ms = 5;
// A ping-pong on a bulk endpoint needs three a frame; a client that floods the bus gets no more.
constexpr int kMaxWakesPerFrame = 32;

/// The frame thread outranks whoever asks for a report: a holder of the lock must inherit its
/// priority, or a servo thread in between could hold up the bus.
class PriorityMutex {
 public:
  PriorityMutex() {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    const int error = pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
    if (error != 0) {
      throw EmulatorError(std::string("the emulator's mutex can't be made: ") +
                          std::strerror(error));
    }
  }
  ~PriorityMutex() { pthread_mutex_destroy(&mutex_); }
  PriorityMutex(const PriorityMutex&) = delete;
  PriorityMutex& operator=(const PriorityMutex&) = delete;
  void lock() noexcept { pthread_mutex_lock(&mutex_); }
  void unlock() noexcept { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_;
};

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) noexcept : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor() {
    if (fd_ >= 0) {
      ::close(fd_);
    }
  }
  [[nodiscard]] int get() const noexcept { return fd_; }

 private:
  int fd_;
};

struct Connection {
  FileDescriptor socket;
  rt::TimePoint opened{};
  std::vector<std::uint8_t> received;
  std::vector<std::uint8_t> unsent;
  std::optional<std::size_t> device;  // imported
  std::vector<Urb> urbs;
  std::optional<CloseReason> closing;

  void close(CloseReason reason) noexcept {
    if (!closing) {
      closing = reason;
    }
  }
};

struct Port {
  std::unique_ptr<EmulatedDevice> device;
  usbip::DeviceInfo info;
  bool attached = false;
  bool unplugged = false;

  [[nodiscard]] bool available() const noexcept { return !unplugged && device->plugged_in(); }
  [[nodiscard]] bool has_bulk_endpoint() const noexcept {
    const auto endpoints = device->endpoints();
    return std::any_of(endpoints.begin(), endpoints.end(), [](const UsbEndpoint& endpoint) {
      return endpoint.type == UsbTransferType::kBulk;
    });
  }
  [[nodiscard]] const UsbEndpoint* endpoint(std::uint8_t address) const noexcept {
    for (const UsbEndpoint& endpoint : device->endpoints()) {
      if (endpoint.address == address) {
        return &endpoint;
      }
    }
    return nullptr;
  }
};

struct FrameCounts {
  std::uint64_t frames = 0;
  std::uint64_t late = 0;
  std::uint64_t skipped = 0;
  rt::Duration worst{};
};

FileDescriptor listen_on(const ListenAddress& where, std::uint16_t& bound_port) {
  const auto fail = [&](const char* call, const char* remedy) {
    const int error = errno;
    throw EmulatorError("listen address " + where.text() + ": " + call + " failed (" +
                        std::strerror(error) + ")" + remedy);
  };
  FileDescriptor socket(
      ::socket(where.ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) {
    fail("socket", "");
  }
  const int on = 1;
  // Without it a port stays refused for a minute after the last emulator on it has ended.
  if (::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0) {
    fail("setsockopt", "");
  }
  sockaddr_storage storage{};
  socklen_t size = 0;
  if (where.ipv6) {
    auto* address = reinterpret_cast<sockaddr_in6*>(&storage);
    address->sin6_family = AF_INET6;
    address->sin6_port = htons(where.port);
    ::inet_pton(AF_INET6, where.address.c_str(), &address->sin6_addr);
    size = sizeof *address;
  } else {
    auto* address = reinterpret_cast<sockaddr_in*>(&storage);
    address->sin_family = AF_INET;
    address->sin_port = htons(where.port);
    ::inet_pton(AF_INET, where.address.c_str(), &address->sin_addr);
    size = sizeof *address;
  }
  auto* generic = reinterpret_cast<sockaddr*>(&storage);
  if (::bind(socket.get(), generic, size) != 0) {
    fail("bind",
         errno == EADDRINUSE
             ? "; another emulator or usbipd holds the port: stop it, choose another port, "
               "or port 0 for any free one"
             : (errno == EACCES ? "; ports below 1024 need root: choose a higher one" : ""));
  }
  if (::listen(socket.get(), 128) != 0) {
    fail("listen",
         errno == EADDRINUSE ? "; another server holds the port: choose another one" : "");
  }
  if (::getsockname(socket.get(), generic, &size) != 0) {
    fail("getsockname", "");
  }
  bound_port = ntohs(where.ipv6 ? reinterpret_cast<sockaddr_in6*>(&storage)->sin6_port
                                : reinterpret_cast<sockaddr_in*>(&storage)->sin_port);
  return socket;
}

}  // namespace

const char* to_string(CloseReason reason) noexcept {
  switch (reason) {
    case CloseReason::kServed:
      return "served";
    case CloseReason::kClientClosed:
      return "client closed";
    case CloseReason::kTruncated:
      return "truncated message";
    case CloseReason::kSocketError:
      return "socket error";
    case CloseReason::kBadVersion:
      return "wrong protocol version";
    case CloseReason::kUnknownOperation:
      return "unknown operation";
    case CloseReason::kUnknownCommand:
      return "unknown command";
    case CloseReason::kBadDirection:
      return "bad direction";
    case CloseReason::kWrongDevice:
      return "wrong device id";
    case CloseReason::kBadTransferLength:
      return "bad transfer length";
    case CloseReason::kIsochronous:
      return "isochronous transfer";
    case CloseReason::kTooManyUrbs:
      return "too many pending transfers";
    case CloseReason::kDuplicateSequence:
      return "duplicate sequence number";
    case CloseReason::kSlowClient:
      return "slow client";
    case CloseReason::kIdle:
      return "idle";
    case CloseReason::kTooManyConnections:
      return "too many connections";
    case CloseReason::kUnplugged:
      return "unplugged";
    case CloseReason::kServerStopped:
      return "server stopped";
    case CloseReason::kCount:
      break;
  }
  return "unknown";
}

std::string ListenAddress::text() const {
  return (ipv6 ? "[" + address + "]" : address) + ":" + std::to_string(port);
}

ListenAddress parse_listen_address(std::string_view text) {
  const std::string quoted = "listen address '" + std::string(text) + "'";
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos || colon == 0) {
    throw EmulatorError(quoted + " is not ADDR:PORT; write for example 127.0.0.1:3240");
  }
  std::string_view host = text.substr(0, colon);
  const std::string_view port_text = text.substr(colon + 1);
  ListenAddress result;
  unsigned port = 0;
  const auto [end, error] =
      std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
  if (error != std::errc{} || end != port_text.data() + port_text.size() || port > 65535) {
    throw EmulatorError(quoted + ": port '" + std::string(port_text) +
                        "' is not a number from 0 to 65535 (0: any free port)");
  }
  result.port = static_cast<std::uint16_t>(port);

  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) {
    host = host.substr(1, host.size() - 2);
  }
  result.address = host == "localhost" ? "127.0.0.1" : std::string(host);
  in_addr ipv4{};
  in6_addr ipv6{};
  bool loopback = false;
  if (!bracketed && ::inet_pton(AF_INET, result.address.c_str(), &ipv4) == 1) {
    loopback = (ntohl(ipv4.s_addr) >> 24) == 127;
  } else if (bracketed && ::inet_pton(AF_INET6, result.address.c_str(), &ipv6) == 1) {
    result.ipv6 = true;
    loopback = IN6_IS_ADDR_LOOPBACK(&ipv6);
  } else {
    throw EmulatorError(quoted + ": '" + std::string(host) +
                        "' is not a numeric address; write 127.0.0.1, [::1] or localhost");
  }
  if (!loopback) {
    throw EmulatorError(quoted +
                        " is not loopback: USB/IP has neither authentication nor encryption, and "
                        "the device obeys whoever connects; use 127.0.0.1:" +
                        std::to_string(port) +
                        " and reach it from another machine through an SSH tunnel (ssh -L)");
  }
  return result;
}

struct EmulatorServer::Impl {
  explicit Impl(const ServerOptions& options);

  void run();
  void run_as_fast_as_asked();
  void frame(rt::TimePoint now);
  /// Serves bulk endpoints, which a bus does not make wait for its next frame, until `deadline`.
  void serve_bulk_until(rt::TimePoint deadline);
  void accept_clients(rt::TimePoint now);
  void receive(Connection& connection, rt::TimePoint now);
  /// @returns bytes consumed; 0 when the message is not complete or the connection is closing.
  std::size_t take_message(Connection& connection, std::span<const std::uint8_t> bytes,
                           rt::TimePoint now);
  std::size_t take_operation(Connection& connection, std::span<const std::uint8_t> bytes);
  std::size_t take_command(Connection& connection, std::span<const std::uint8_t> bytes,
                           rt::TimePoint now);
  void import(Connection& connection, std::string_view busid);
  void submit(Connection& connection, const usbip::Command& command,
              std::span<const std::uint8_t> data, rt::TimePoint now);
  void unlink(Connection& connection, const usbip::Command& command);
  void run_device(Port& port, Connection* client, rt::TimePoint now);
  void send(Connection& connection);
  void release(Connection& connection, rt::TimePoint now);
  EmulatorReport report(std::size_t index) const;

  mutable PriorityMutex mutex;  // guards everything below but what start() and stop() own
  std::vector<Port> ports;
  std::vector<Connection> connections;
  Statistics statistics;
  FrameCounts frames;
  std::vector<std::uint8_t> read_buffer = std::vector<std::uint8_t>(kMaxReadPerFrame);
  std::vector<pollfd> bulk_sockets;  // of the frame thread alone

  ListenAddress listen_address;
  FileDescriptor listener;
  rt::Duration frame_period{};
  Pace pace = Pace::kRealTime;

  std::atomic<bool> stopping{false};
  std::promise<rt::Scheduling> scheduling;
  std::thread thread;
};

EmulatorServer::Impl::Impl(const ServerOptions& options)
    : listen_address(parse_listen_address(options.listen)) {
  if (options.devices.empty()) {
    throw EmulatorError("the emulator has no device; give at least one profile");
  }
  const int period_us = options.devices.front().profile.usb.frame_period_us;
  for (const DeviceOptions& device : options.devices) {
    const int own_us = device.profile.usb.frame_period_us;
    if (own_us != period_us || own_us < 125) {
      throw EmulatorError("device " + device.profile.name + ": a bus frame of " +
                          std::to_string(own_us) +
                          " us can't be emulated; use at least 125 us, the same for all devices");
    }
  }
  frame_period = std::chrono::microseconds(period_us);
  pace = options.pace;
  const rt::TimePoint start = rt::Clock::now();
  for (std::size_t i = 0; i < options.devices.size(); ++i) {
    auto device = make_emulated_device(options.devices[i], start);
    const UsbIdentity identity = device->identity();
    usbip::DeviceInfo info;
    info.busid = "1-" + std::to_string(i + 1);
    info.path = "/sys/devices/platform/forcegrid/usb1/" + info.busid;
    info.bus_number = 1;
    info.device_number = static_cast<std::uint32_t>(i + 2);  // 1 is the root hub
    info.speed = period_us < 1000 ? usbip::kSpeedHigh : usbip::kSpeedFull;
    info.vendor_id = identity.vendor_id;
    info.product_id = identity.product_id;
    info.device_release = identity.device_release;
    info.interfaces = identity.interfaces;
    info.interface_class = identity.interface_class;
    info.interface_subclass = identity.interface_subclass;
    info.interface_protocol = identity.interface_protocol;
    ports.push_back(Port{.device = std::move(device), .info = std::move(info)});
  }
  listener = listen_on(listen_address, listen_address.port);
}

void EmulatorServer::Impl::run() {
  rt::name_current_thread("emulator-frame");
  scheduling.set_value(rt::make_current_thread_realtime(rt::kEmulatorFramePriority));
  rt::TimePoint deadline = rt::Clock::now() + frame_period;
  while (!stopping.load(std::memory_order_acquire)) {
    serve_bulk_until(deadline);
    rt::sleep_until(deadline);
    const rt::TimePoint now = rt::Clock::now();
    const rt::Duration lateness = now - deadline;
    {
      const std::lock_guard lock(mutex);
      ++frames.frames;
      frames.worst = std::max(frames.worst, lateness);
      if (lateness > frame_period / 2) {
        ++frames.late;
      }
      frame(now);
    }
    deadline += frame_period;
    const rt::TimePoint earliest = std::max(now + frame_period / 2, rt::Clock::now());
    if (deadline < earliest) {
      const auto missed = (earliest - deadline + frame_period - rt::Duration(1)) / frame_period;
      deadline += missed * frame_period;
      const std::lock_guard lock(mutex);
      frames.skipped += static_cast<std::uint64_t>(missed);
    }
  }
}

void EmulatorServer::Impl::run_as_fast_as_asked() {
  rt::name_current_thread("emulator-frame");
  scheduling.set_value({});
  rt::TimePoint now = rt::Clock::now();
  std::vector<pollfd> sockets;
  while (!stopping.load(std::memory_order_acquire)) {
    bool asked = false;
    sockets.assign(1, {listener.get(), POLLIN, 0});
    {
      const std::lock_guard lock(mutex);
      for (const Connection& connection : connections) {
        sockets.push_back({connection.socket.get(), POLLIN, 0});
        asked = asked || !connection.urbs.empty();
      }
    }
    if (!asked) {
      static_cast<void>(::poll(sockets.data(), sockets.size(), kIdlePoll_ms));
    }
    now += frame_period;
    const std::lock_guard lock(mutex);
    ++frames.frames;
    frame(now);
  }
}

void EmulatorServer::Impl::serve_bulk_until(rt::TimePoint deadline) {
  for (int wake = 0; wake < kMaxWakesPerFrame; ++wake) {
    rt::TimePoint until = deadline;
    bulk_sockets.clear();
    {
      const std::lock_guard lock(mutex);
      for (const Connection& connection : connections) {
        if (connection.closing || !connection.device ||
            !ports[*connection.device].has_bulk_endpoint()) {
          continue;
        }
        bulk_sockets.push_back({connection.socket.get(), POLLIN, 0});
        if (const auto due = ports[*connection.device].device->wake_time()) {
          until = std::min(until, *due);
        }
      }
    }
    const rt::Duration wait = std::max(until - rt::Clock::now(), rt::Duration::zero());
    if (bulk_sockets.empty()) {
      return;
    }
    const auto wait_s = std::chrono::duration_cast<std::chrono::seconds>(wait);
    const timespec timeout{.tv_sec = wait_s.count(),
                           .tv_nsec = std::chrono::nanoseconds(wait - wait_s).count()};
    // A socket that unplug() closes meanwhile only ends the wait.
    (void)::ppoll(bulk_sockets.data(), bulk_sockets.size(), &timeout, nullptr);
    const rt::TimePoint now = rt::Clock::now();
    if (now >= deadline) {
      return;
    }
    const std::lock_guard lock(mutex);
    for (Connection& connection : connections) {
      if (!connection.device || !ports[*connection.device].has_bulk_endpoint()) {
        continue;
      }
      receive(connection, now);
      if (!connection.closing) {
        run_device(ports[*connection.device], &connection, now);
        send(connection);
      }
    }
  }
}

void EmulatorServer::Impl::frame(rt::TimePoint now) {
  accept_clients(now);
  for (Connection& connection : connections) {
    receive(connection, now);
  }
  for (std::size_t i = 0; i < ports.size(); ++i) {
    Connection* client = nullptr;
    for (Connection& connection : connections) {
      if (connection.device == i && !connection.closing) {
        client = &connection;
      }
    }
    run_device(ports[i], client, now);
  }
  for (Connection& connection : connections) {
    send(connection);
    if (!connection.device && now - connection.opened > kIdleLimit) {
      // Also ends a served client that never took its reply.
      connection.unsent.clear();
      connection.close(CloseReason::kIdle);
    }
    const bool reply_pending =
        connection.closing == CloseReason::kServed && !connection.unsent.empty();
    if (connection.closing && !reply_pending) {
      release(connection, now);
    }
  }
  std::erase_if(connections, [](const Connection& c) { return c.socket.get() < 0; });
}

void EmulatorServer::Impl::accept_clients(rt::TimePoint now) {
  for (int i = 0; i < 4; ++i) {
    FileDescriptor client(
        ::accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (client.get() < 0) {
      return;
    }
    ++statistics.connections;
    if (connections.size() >= kMaxConnections) {
      ++statistics.closed[static_cast<std::size_t>(CloseReason::kTooManyConnections)];
      continue;
    }
    const int on = 1;
    ::setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    Connection& connection = connections.emplace_back();
    connection.socket = std::move(client);
    connection.opened = now;
  }
}

void EmulatorServer::Impl::receive(Connection& connection, rt::TimePoint now) {
  if (connection.closing) {
    return;
  }
  std::optional<CloseReason> ended;
  // A client that commands faster than frames pass is held back by its full socket.
  if (connection.received.size() < kMaxReadPerFrame) {
    const ssize_t size =
        ::recv(connection.socket.get(), read_buffer.data(), read_buffer.size(), MSG_DONTWAIT);
    if (size > 0) {
      connection.received.insert(connection.received.end(), read_buffer.begin(),
                                 read_buffer.begin() + size);
    } else if (size == 0) {
      ended = CloseReason::kClientClosed;
    } else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
      ended = CloseReason::kSocketError;
    }
  }
  std::size_t consumed = 0;
  for (std::size_t i = 0; i < kMaxCommandsPerFrame && !connection.closing; ++i) {
    const std::size_t size =
        take_message(connection, std::span(connection.received).subspan(consumed), now);
    if (size == 0) {
      break;
    }
    consumed += size;
  }
  connection.received.erase(connection.received.begin(),
                            connection.received.begin() + static_cast<std::ptrdiff_t>(consumed));
  if (ended == CloseReason::kClientClosed && !connection.received.empty()) {
    ended = CloseReason::kTruncated;
  }
  if (ended) {
    connection.close(*ended);
  }
}

std::size_t EmulatorServer::Impl::take_message(Connection& connection,
                                               std::span<const std::uint8_t> bytes,
                                               rt::TimePoint now) {
  return connection.device ? take_command(connection, bytes, now)
                           : take_operation(connection, bytes);
}

std::size_t EmulatorServer::Impl::take_operation(Connection& connection,
                                                 std::span<const std::uint8_t> bytes) {
  if (bytes.size() < 4) {
    return 0;
  }
  if (usbip::read_uint16(bytes.first<2>()) != usbip::kVersion) {
    connection.close(CloseReason::kBadVersion);
    return 0;
  }
  const std::uint16_t operation = usbip::read_uint16(bytes.subspan<2, 2>());
  if (operation != usbip::kOpReqDevlist && operation != usbip::kOpReqImport) {
    connection.close(CloseReason::kUnknownOperation);
    return 0;
  }
  const std::size_t size =
      operation == usbip::kOpReqImport ? usbip::kImportRequestBytes : usbip::kOpHeaderBytes;
  if (bytes.size() < size) {
    return 0;
  }
  if (operation == usbip::kOpReqDevlist) {
    std::vector<usbip::DeviceInfo> plugged;
    for (const Port& port : ports) {
      if (port.available()) {
        plugged.push_back(port.info);
        plugged.back().configuration = port.device->configured() ? 1 : 0;
      }
    }
    usbip::append_devlist_reply(connection.unsent, plugged);
    connection.close(CloseReason::kServed);
    return size;
  }
  const auto* text = reinterpret_cast<const char*>(bytes.data() + usbip::kOpHeaderBytes);
  import(connection, std::string_view(text, ::strnlen(text, usbip::kBusidBytes)));
  return size;
}

void EmulatorServer::Impl::import(Connection& connection, std::string_view busid) {
  auto status = usbip::OpStatus::kNoDevice;
  usbip::DeviceInfo info;
  for (std::size_t i = 0; i < ports.size(); ++i) {
    Port& port = ports[i];
    if (port.info.busid != busid) {
      continue;
    }
    info = port.info;
    info.configuration = port.device->configured() ? 1 : 0;
    if (!port.available()) {
      status = usbip::OpStatus::kNoDevice;
    } else if (port.attached) {
      status = usbip::OpStatus::kDeviceBusy;
    } else {
      status = usbip::OpStatus::kOk;
      port.attached = true;
      connection.device = i;
    }
  }
  usbip::append_import_reply(connection.unsent, status, info);
  if (status != usbip::OpStatus::kOk) {
    connection.close(CloseReason::kServed);
  }
}

std::size_t EmulatorServer::Impl::take_command(Connection& connection,
                                               std::span<const std::uint8_t> bytes,
                                               rt::TimePoint now) {
  if (bytes.size() < usbip::kCommandBytes) {
    return 0;
  }
  const usbip::Command command = usbip::read_command(bytes.first<usbip::kCommandBytes>());
  const auto refuse = [&connection](CloseReason reason) -> std::size_t {
    connection.close(reason);
    return 0;
  };
  if (command.command != usbip::kCmdSubmit && command.command != usbip::kCmdUnlink) {
    return refuse(CloseReason::kUnknownCommand);
  }
  if (command.devid != ports[*connection.device].info.devid()) {
    return refuse(CloseReason::kWrongDevice);
  }
  if (command.command == usbip::kCmdUnlink) {
    unlink(connection, command);
    return usbip::kCommandBytes;
  }
  if (command.direction > 1) {
    return refuse(CloseReason::kBadDirection);
  }
  if (command.transfer_bytes < 0 || command.transfer_bytes > usbip::kMaxTransferBytes) {
    return refuse(CloseReason::kBadTransferLength);
  }
  if (command.packets != 0 && command.packets != -1) {
    return refuse(CloseReason::kIsochronous);
  }
  const std::size_t data_bytes =
      command.direction == 0 ? static_cast<std::size_t>(command.transfer_bytes) : 0;
  if (bytes.size() < usbip::kCommandBytes + data_bytes) {
    return 0;
  }
  submit(connection, command, bytes.subspan(usbip::kCommandBytes, data_bytes), now);
  return usbip::kCommandBytes + data_bytes;
}

void EmulatorServer::Impl::submit(Connection& connection, const usbip::Command& command,
                                  std::span<const std::uint8_t> data, rt::TimePoint now) {
  Port& port = ports[*connection.device];
  const bool in = command.direction == 1;
  const auto finish = [&](std::int32_t status, std::size_t actual_bytes = 0,
                          std::span<const std::uint8_t> reply = {}) {
    usbip::append_submit_reply(connection.unsent, command.sequence, status,
                               static_cast<std::uint32_t>(actual_bytes), reply);
  };
  if (command.endpoint == 0) {
    const SetupPacket setup = SetupPacket::from_bytes(command.setup);
    auto reply = port.device->control(setup, data, now);
    if (reply.stalled) {
      finish(usbip::kStalled);
    } else if (setup.device_to_host()) {
      const std::size_t size =
          in ? std::min(reply.data.size(), static_cast<std::size_t>(command.transfer_bytes)) : 0;
      finish(0, size, std::span(reply.data).first(size));
    } else {
      finish(0, data.size());
    }
    return;
  }
  const UsbEndpoint* endpoint =
      command.endpoint < 16
          ? port.endpoint(static_cast<std::uint8_t>(command.endpoint | (in ? 0x80U : 0U)))
          : nullptr;
  if (endpoint == nullptr) {
    finish(usbip::kStalled);
    return;
  }
  if (std::any_of(connection.urbs.begin(), connection.urbs.end(),
                  [&command](const Urb& urb) { return urb.sequence == command.sequence; })) {
    connection.close(CloseReason::kDuplicateSequence);
    return;
  }
  if (connection.urbs.size() >= kMaxPendingUrbs) {
    connection.close(CloseReason::kTooManyUrbs);
    return;
  }
  Urb& urb = connection.urbs.emplace_back();
  urb.sequence = command.sequence;
  urb.endpoint = *endpoint;
  urb.buffer_bytes = static_cast<std::size_t>(command.transfer_bytes);
  urb.data.assign(data.begin(), data.end());
  urb.zero_packet = (command.transfer_flags & usbip::kFlagZeroPacket) != 0 && !data.empty();
  urb.short_is_error = (command.transfer_flags & usbip::kFlagShortNotOk) != 0;
}

void EmulatorServer::Impl::unlink(Connection& connection, const usbip::Command& command) {
  const std::size_t removed = std::erase_if(connection.urbs, [&command](const Urb& urb) {
    return urb.sequence == command.unlink_sequence;
  });
  usbip::append_unlink_reply(connection.unsent, command.sequence,
                             removed > 0 ? usbip::kUnlinked : 0);
}

void EmulatorServer::Impl::run_device(Port& port, Connection* client, rt::TimePoint now) {
  EmulatedDevice& device = *port.device;
  if (client == nullptr) {
    std::vector<Urb> no_urbs;
    std::vector<std::uint8_t> no_replies;
    UrbHost nobody(no_urbs, no_replies);
    device.run(now, nobody);
    return;
  }
  UrbHost host(client->urbs, client->unsent);
  for (const UsbEndpoint& endpoint : device.endpoints()) {
    if (!device.configured()) {
      host.fail_all(endpoint.address, usbip::kBusError);
    } else if (device.halted(endpoint.address)) {
      host.fail_all(endpoint.address, usbip::kStalled);
    }
  }
  device.run(now, host);
  if (!device.plugged_in()) {
    client->unsent.clear();
    client->close(CloseReason::kUnplugged);
  }
}

void EmulatorServer::Impl::send(Connection& connection) {
  while (!connection.unsent.empty()) {
    const ssize_t sent = ::send(connection.socket.get(), connection.unsent.data(),
                                connection.unsent.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent > 0) {
      connection.unsent.erase(connection.unsent.begin(), connection.unsent.begin() + sent);
    } else if (errno != EINTR) {
      if (errno != EAGAIN && errno != EWOULDBLOCK) {
        connection.unsent.clear();
        connection.close(CloseReason::kSocketError);
      }
      break;
    }
  }
  if (connection.unsent.size() > kMaxUnsentBytes) {
    connection.unsent.clear();
    connection.close(CloseReason::kSlowClient);
  }
}

void EmulatorServer::Impl::release(Connection& connection, rt::TimePoint now) {
  ++statistics.closed[static_cast<std::size_t>(*connection.closing)];
  if (connection.device) {
    Port& port = ports[*connection.device];
    port.attached = false;
    port.device->bus_reset(now);
    connection.device.reset();
  }
  connection.socket = FileDescriptor();
}

EmulatorReport EmulatorServer::Impl::report(std::size_t index) const {
  const Port& port = ports.at(index);
  EmulatorReport result = port.device->report();
  result.busid = port.info.busid;
  result.attached = port.attached;
  result.unplugged = !port.available();
  result.frames = frames.frames;
  result.frames_late = frames.late;
  result.frames_skipped = frames.skipped;
  result.worst_lateness_us = 1e6 * rt::seconds(frames.worst);
  return result;
}

EmulatorServer::EmulatorServer(const ServerOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}

EmulatorServer::~EmulatorServer() { stop(); }

void EmulatorServer::start() {
  if (impl_->thread.joinable() || impl_->stopping.load()) {
    throw EmulatorError("the emulator has been started before; make a new one");
  }
  auto settled = impl_->scheduling.get_future();
  impl_->thread = std::thread([impl = impl_.get()] {
    if (impl->pace == Pace::kRealTime) {
      impl->run();
    } else {
      impl->run_as_fast_as_asked();
    }
  });
  rt::Scheduling scheduling = settled.get();
  const std::lock_guard lock(impl_->mutex);
  impl_->statistics.scheduling = std::move(scheduling);
}

void EmulatorServer::stop() noexcept {
  impl_->stopping.store(true, std::memory_order_release);
  if (impl_->thread.joinable()) {
    impl_->thread.join();
  }
  const std::lock_guard lock(impl_->mutex);
  for (Connection& connection : impl_->connections) {
    connection.close(CloseReason::kServerStopped);
    impl_->release(connection, rt::Clock::now());
  }
  impl_->connections.clear();
  impl_->listener = FileDescriptor();
}

std::uint16_t EmulatorServer::port() const noexcept { return impl_->listen_address.port; }

std::string EmulatorServer::address() const { return impl_->listen_address.text(); }

std::size_t EmulatorServer::device_count() const noexcept { return impl_->ports.size(); }

EmulatorServer::DeviceHandle EmulatorServer::device(std::size_t index) {
  if (index >= impl_->ports.size()) {
    throw std::out_of_range("emulated device " + std::to_string(index) + " of " +
                            std::to_string(impl_->ports.size()));
  }
  return {*this, index};
}

EmulatorReport EmulatorServer::report(std::size_t index) const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->report(index);
}

EmulatorServer::Statistics EmulatorServer::statistics() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->statistics;
}

const std::string& EmulatorServer::DeviceHandle::busid() const {
  return server_->impl_->ports[index_].info.busid;
}

EmulatorReport EmulatorServer::DeviceHandle::report() const { return server_->report(index_); }

std::vector<CounterSample> EmulatorServer::DeviceHandle::samples() const {
  const std::lock_guard lock(server_->impl_->mutex);
  return server_->impl_->ports[index_].device->samples();
}

void EmulatorServer::DeviceHandle::unplug() {
  Impl& impl = *server_->impl_;
  const std::lock_guard lock(impl.mutex);
  impl.ports[index_].unplugged = true;
  for (Connection& connection : impl.connections) {
    if (connection.device == index_) {
      connection.unsent.clear();
      connection.close(CloseReason::kUnplugged);
      impl.release(connection, rt::Clock::now());
    }
  }
  std::erase_if(impl.connections, [](const Connection& c) { return c.socket.get() < 0; });
}

void EmulatorServer::DeviceHandle::replug() {
  const std::lock_guard lock(server_->impl_->mutex);
  server_->impl_->ports[index_].unplugged = false;
}

void EmulatorServer::DeviceHandle::press_calibration_button() {
  const std::lock_guard lock(server_->impl_->mutex);
  server_->impl_->ports[index_].device->press_calibration_button();
}

}  // namespace forcegrid::emulator
