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

namespace forcegrid::emulator {

namespace {

constexpr rt::Duration kIdleLimit = std::chrono::seconds(10);
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

struct FrameCounts {
  std::uint64_t frames = 0;
  std::uint64_t late = 0;
  std::uint64_t skipped = 0;
  rt::Duration worst{};
};

}  // namespace

struct EmulatorServer::Impl {
  explicit Impl(const ServerOptions& options);

  void run();
  void run_as_fast_as_asked();
  void frame(rt::TimePoint now);
  /// Serves bulk endpoints, which a bus does not make wait for its next frame, until `deadline`.
  void serve_bulk_until(rt::TimePoint deadline);
  void accept_clients(rt::TimePoint now);
  void release(UsbipClient& client, rt::TimePoint now);
  EmulatorReport report(std::size_t index) const;

  mutable PriorityMutex mutex;  // guards everything below but what start() and stop() own
  std::vector<BusPort> ports;
  std::vector<UsbipClient> clients;
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
    ports.push_back(BusPort{.device = std::move(device), .info = std::move(info)});
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
      for (const UsbipClient& client : clients) {
        sockets.push_back({client.socket(), POLLIN, 0});
        asked = asked || client.waits_for_transfer();
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
    // A socket that unplug() closes meanwhile only ends the wait.
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
  for (UsbipClient& client : clients) {
    client.receive(ports, read_buffer, now);
  }
  for (std::size_t i = 0; i < ports.size(); ++i) {
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
      // Also ends a served client that never took its reply.
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
