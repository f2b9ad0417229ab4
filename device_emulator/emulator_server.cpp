// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulator_server.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstring>
#include <future>
#include <mutex>
#include <utility>

#include "device_emulator/hand_target_socket.h"

namespace forcegrid::emulator {

namespace {

constexpr rt::Duration kIdleLimit = std::chrono::seconds(10);
constexpr int kIdlePoll_ms = 5;
// A ping-pong on a bulk endpoint needs three per frame; a client that floods the bus gets no more.
constexpr int kMaxWakesPerFrame = 32;

/// The frame thread has a higher priority than those who ask for a report. A holder of the lock
/// must inherit it, or a servo thread in between could hold up the bus.
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

constexpr int kHighSpeedFrame_us = 125;
constexpr int kFullSpeedFrame_us = 1000;

/// The devices of one speed, which share frames.
struct Bus {
  rt::Duration frame_period{};
  rt::TimePoint deadline{};  ///< of the next frame; of the frame thread alone
  std::uint32_t devices = 0;
  std::uint64_t frames = 0;
  std::uint64_t late = 0;
  std::uint64_t skipped = 0;
  rt::Duration worst_lateness{};

  [[nodiscard]] bool is_due(rt::TimePoint now) const noexcept { return deadline <= now; }
  /// Counts a frame that begins at `now`.
  void count_frame(rt::TimePoint now) noexcept {
    const rt::Duration lateness = now - deadline;
    ++frames;
    worst_lateness = std::max(worst_lateness, lateness);
    if (lateness > frame_period / 2) {
      ++late;
    }
  }
  /// The next deadline after a frame that began at `began`: at least half a period after it.
  void plan_next_frame(rt::TimePoint began) noexcept {
    deadline += frame_period;
    const rt::TimePoint earliest = std::max(began + frame_period / 2, rt::Clock::now());
    if (deadline < earliest) {
      const auto missed = (earliest - deadline + frame_period - rt::Duration(1)) / frame_period;
      deadline += missed * frame_period;
      skipped += static_cast<std::uint64_t>(missed);
    }
  }
};

}  // namespace

struct EmulatorServer::Impl {
  explicit Impl(const ServerOptions& options);

  void run();
  void run_as_fast_as_asked();
  /// One frame of every bus that is due.
  void frame(rt::TimePoint now);
  void add_device(const DeviceOptions& options, rt::TimePoint start);
  /// The bus of that frame period, made where there is none yet. @returns its index.
  std::size_t bus_of_period(rt::Duration frame_period);
  Bus& bus_of(const BusPort& port) { return buses[port.info.bus_number - 1]; }
  const Bus& bus_of(const BusPort& port) const { return buses[port.info.bus_number - 1]; }
  void begin_all_at(rt::TimePoint start);
  rt::TimePoint next_deadline() const noexcept;
  /// Whether the client's device, if it has one, is on a bus whose frame is due.
  bool is_due(const UsbipClient& client, rt::TimePoint now) const;
  /// Serves bulk endpoints, which need not wait for the next bus frame, until `deadline`.
  void serve_bulk_until(rt::TimePoint deadline);
  void accept_clients(rt::TimePoint now);
  void release(UsbipClient& client, rt::TimePoint now);
  EmulatorReport report(std::size_t index) const;

  mutable PriorityMutex mutex;  // guards all below, except what start() and stop() own
  std::vector<BusPort> ports;
  std::vector<UsbipClient> clients;
  std::vector<Bus> buses;  // bus n of the device list is buses[n - 1]
  Statistics statistics;
  std::vector<std::uint8_t> read_buffer = std::vector<std::uint8_t>(kMaxReadPerFrame);
  std::vector<pollfd> bulk_sockets;  // of the frame thread alone

  ListenAddress listen_address;
  FileDescriptor listener;
  std::unique_ptr<HandTargetSocket> hand_target;  // null: nobody points
  std::optional<HandKind> hand;                   // that it has asked for
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
  pace = options.pace;
  const rt::TimePoint start = rt::Clock::now();
  for (const DeviceOptions& device : options.devices) {
    add_device(device, start);
  }
  if (!options.hand_target.empty()) {
    hand_target = std::make_unique<HandTargetSocket>(options.hand_target);
  }
  listener = listen_on(listen_address, listen_address.port);
}

void EmulatorServer::Impl::add_device(const DeviceOptions& options, rt::TimePoint start) {
  const int period_us = options.profile.usb.frame_period_us;
  if (period_us != kHighSpeedFrame_us && period_us != kFullSpeedFrame_us) {
    throw EmulatorError("device " + options.profile.name + ": a bus frame of " +
                        std::to_string(period_us) +
                        " us can't be emulated; usb.frame_period_us is 125 (high speed) or 1000 "
                        "(full speed)");
  }
  auto device = make_emulated_device(options, start);
  const UsbIdentity identity = device->identity();
  const std::size_t bus = bus_of_period(std::chrono::microseconds(period_us));
  const std::string bus_number = std::to_string(bus + 1);
  const std::uint32_t port_number = ++buses[bus].devices;
  usbip::DeviceInfo info;
  info.busid = bus_number + "-" + std::to_string(port_number);
  info.path = "/sys/devices/platform/forcegrid/usb" + bus_number + "/" + info.busid;
  info.bus_number = static_cast<std::uint32_t>(bus + 1);
  info.device_number = port_number + 1;  // 1 is the root hub
  info.speed = period_us == kHighSpeedFrame_us ? usbip::kSpeedHigh : usbip::kSpeedFull;
  info.vendor_id = identity.vendor_id;
  info.product_id = identity.product_id;
  info.device_release = identity.device_release;
  info.interfaces = identity.interfaces;
  info.interface_class = identity.interface_class;
  info.interface_subclass = identity.interface_subclass;
  info.interface_protocol = identity.interface_protocol;
  ports.push_back(BusPort{.device = std::move(device), .info = std::move(info)});
}

std::size_t EmulatorServer::Impl::bus_of_period(rt::Duration frame_period) {
  const auto found = std::find_if(buses.begin(), buses.end(), [frame_period](const Bus& bus) {
    return bus.frame_period == frame_period;
  });
  if (found != buses.end()) {
    return static_cast<std::size_t>(found - buses.begin());
  }
  buses.push_back({.frame_period = frame_period});
  return buses.size() - 1;
}

void EmulatorServer::Impl::begin_all_at(rt::TimePoint start) {
  for (Bus& bus : buses) {
    bus.deadline = start + bus.frame_period;
  }
}

rt::TimePoint EmulatorServer::Impl::next_deadline() const noexcept {
  return std::min_element(buses.begin(), buses.end(),
                          [](const Bus& a, const Bus& b) { return a.deadline < b.deadline; })
      ->deadline;
}

bool EmulatorServer::Impl::is_due(const UsbipClient& client, rt::TimePoint now) const {
  return !client.device() || bus_of(ports[*client.device()]).is_due(now);
}

void EmulatorServer::Impl::run() {
  rt::name_current_thread("emulator-frame");
  scheduling.set_value(rt::make_current_thread_realtime(rt::kEmulatorFramePriority));
  begin_all_at(rt::Clock::now());
  while (!stopping.load(std::memory_order_acquire)) {
    const rt::TimePoint deadline = next_deadline();
    serve_bulk_until(deadline);
    rt::sleep_until(deadline);
    const rt::TimePoint now = rt::Clock::now();
    const std::lock_guard lock(mutex);
    for (Bus& bus : buses) {
      if (bus.is_due(now)) {
        bus.count_frame(now);
      }
    }
    frame(now);
    for (Bus& bus : buses) {
      if (bus.is_due(now)) {
        bus.plan_next_frame(now);
      }
    }
  }
}

void EmulatorServer::Impl::run_as_fast_as_asked() {
  rt::name_current_thread("emulator-frame");
  scheduling.set_value({});
  begin_all_at(rt::Clock::now());
  std::vector<pollfd> sockets;
  while (!stopping.load(std::memory_order_acquire)) {
    bool asked = false;
    sockets.assign(1, {listener.get(), POLLIN, 0});
    {
      const std::lock_guard lock(mutex);
      for (const UsbipClient& client : clients) {
        sockets.push_back({client.socket(), POLLIN, 0});
        asked = asked || client.waits_for_transfer();
      }
    }
    if (!asked) {
      static_cast<void>(::poll(sockets.data(), sockets.size(), kIdlePoll_ms));
    }
    const rt::TimePoint now = next_deadline();
    const std::lock_guard lock(mutex);
    frame(now);
    for (Bus& bus : buses) {
      if (bus.is_due(now)) {
        ++bus.frames;
        bus.deadline += bus.frame_period;
      }
    }
  }
}

void EmulatorServer::Impl::serve_bulk_until(rt::TimePoint deadline) {
  for (int wake = 0; wake < kMaxWakesPerFrame; ++wake) {
    rt::TimePoint until = deadline;
    bulk_sockets.clear();
    {
      const std::lock_guard lock(mutex);
      for (const UsbipClient& client : clients) {
        if (client.closing() || !client.device() || !ports[*client.device()].has_bulk_endpoint()) {
          continue;
        }
        bulk_sockets.push_back({client.socket(), POLLIN, 0});
        if (const auto due = ports[*client.device()].device->wake_time()) {
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
    // If unplug() closes a socket meanwhile, that only ends the wait.
    (void)::ppoll(bulk_sockets.data(), bulk_sockets.size(), &timeout, nullptr);
    const rt::TimePoint now = rt::Clock::now();
    if (now >= deadline) {
      return;
    }
    const std::lock_guard lock(mutex);
    for (UsbipClient& client : clients) {
      if (!client.device() || !ports[*client.device()].has_bulk_endpoint()) {
        continue;
      }
      client.receive(ports, read_buffer, now);
      if (!client.closing()) {
        client.run_device(ports[*client.device()], now);
        client.send();
      }
    }
  }
}

void EmulatorServer::Impl::frame(rt::TimePoint now) {
  accept_clients(now);
  if (hand_target && hand_target->receive()) {
    for (const BusPort& port : ports) {
      port.device->point_hand_at(hand_target->target_D());
      if (hand_target->hand() && hand_target->hand() != hand) {
        port.device->hold_with(*hand_target->hand());
      }
    }
    hand = hand_target->hand();
  }
  for (UsbipClient& client : clients) {
    if (is_due(client, now)) {
      client.receive(ports, read_buffer, now);
    }
  }
  for (std::size_t i = 0; i < ports.size(); ++i) {
    if (!bus_of(ports[i]).is_due(now)) {
      continue;
    }
    const auto owner = std::find_if(clients.begin(), clients.end(), [i](const UsbipClient& client) {
      return client.device() == i && !client.closing();
    });
    if (owner != clients.end()) {
      owner->run_device(ports[i], now);
    } else {
      run_without_client(*ports[i].device, now);
    }
  }
  for (UsbipClient& client : clients) {
    client.send();
    if (!client.device() && now - client.opened() > kIdleLimit) {
      // Also ends a served client that never read its reply.
      client.cut_off(CloseReason::kIdle);
    }
    const bool reply_pending = client.closing() == CloseReason::kServed && client.waits_for_reply();
    if (client.closing() && !reply_pending) {
      release(client, now);
    }
  }
  std::erase_if(clients, [](const UsbipClient& client) { return client.released(); });
}

void EmulatorServer::Impl::accept_clients(rt::TimePoint now) {
  for (int i = 0; i < 4; ++i) {
    FileDescriptor socket(
        ::accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (socket.get() < 0) {
      return;
    }
    ++statistics.connections;
    if (clients.size() >= kMaxConnections) {
      ++statistics.closed[static_cast<std::size_t>(CloseReason::kTooManyConnections)];
      continue;
    }
    const int on = 1;
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    clients.emplace_back(std::move(socket), now);
  }
}

void EmulatorServer::Impl::release(UsbipClient& client, rt::TimePoint now) {
  ++statistics.closed[static_cast<std::size_t>(*client.closing())];
  client.release(ports, now);
}

EmulatorReport EmulatorServer::Impl::report(std::size_t index) const {
  const BusPort& port = ports.at(index);
  EmulatorReport result = port.device->report();
  result.busid = port.info.busid;
  result.attached = port.attached;
  result.unplugged = !port.available();
  if (hand_target) {
    result.hand_target = hand_target->use();
  }
  const Bus& bus = bus_of(port);
  result.frames = bus.frames;
  result.frames_late = bus.late;
  result.frames_skipped = bus.skipped;
  result.worst_lateness_us = 1e6 * rt::seconds(bus.worst_lateness);
  return result;
}

EmulatorServer::EmulatorServer(const ServerOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}

EmulatorServer::~EmulatorServer() { stop(); }

void EmulatorServer::start() {
  if (impl_->thread.joinable() || impl_->stopping.load()) {
    throw EmulatorError("the emulator has already been started; make a new one");
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
  for (UsbipClient& client : impl_->clients) {
    client.close(CloseReason::kServerStopped);
    impl_->release(client, rt::Clock::now());
  }
  impl_->clients.clear();
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
  for (UsbipClient& client : impl.clients) {
    if (client.device() == index_) {
      client.cut_off(CloseReason::kUnplugged);
      impl.release(client, rt::Clock::now());
    }
  }
  std::erase_if(impl.clients, [](const UsbipClient& client) { return client.released(); });
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
