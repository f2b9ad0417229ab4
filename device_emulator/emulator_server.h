// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "device_emulator/close_reason.h"
#include "device_emulator/emulated_device.h"
#include "device_emulator/emulator_report.h"
#include "device_emulator/listen_socket.h"
#include "device_emulator/usbip_client.h"
#include "rt/thread.h"

namespace forcegrid::emulator {
#pragma GCC visibility push(default)

/// How fast bus frames follow each other.
enum class Pace : std::uint8_t {
  kRealTime,
  /// As fast as the computer can: while a client waits, frames follow each other at once, one frame
  /// period apart by the devices' clock. Start-up times and watchdogs then take a fraction of their
  /// real time. For tests that attach thousands of times; not for tests of motors.
  kAsFastAsAsked,
};

struct ServerOptions {
  std::string listen = "127.0.0.1:3240";
  /// Full-speed and high-speed devices may be mixed: each speed has a bus of its own.
  std::vector<DeviceOptions> devices;
  /// Path of a Unix datagram socket that the server binds, for where the hands of all devices are
  /// wanted, see HandTargetSocket; empty: none.
  std::string hand_target;
  Pace pace = Pace::kRealTime;
};

/// Serves emulated devices over USB/IP and runs their buses.
///
/// The devices of one speed share a bus: bus 1 has those of the first device's speed (bus ids 1-1,
/// 1-2, ...), bus 2 those of the other speed (2-1, ...), if there are any.
///
/// One thread serves all clients. In each frame of a bus (usb.frame_period_us, on absolute
/// deadlines) it reads what the clients of that bus have sent, answers control transfers and
/// unlinks at once, passes on what has come for the hands, runs one frame of every device of the
/// bus with the pending URBs, and sends the replies without waiting. It serves devices with bulk
/// endpoints between frames too, whenever their client has sent something or they have something
/// for it. A client that does not read its replies is dropped when kMaxUnsentBytes wait for it; no
/// client can delay a frame. A frame that begins late is counted and not made up for: the next one
/// begins at least half a period later, and physics advances by the true time.
///
/// The device of a client that vanishes gets a bus reset and waits, unconfigured, for the next one;
/// its firmware continues and its watchdog trips.
///
/// Threads: all members may be called from any thread; they lock a mutex (with priority
/// inheritance) against the frame thread, which holds it for the part of each frame that is not
/// sleep.
class EmulatorServer {
 public:
  static constexpr std::size_t kMaxConnections = 64;
  // Per connection:
  static constexpr std::size_t kMaxPendingUrbs = UsbipClient::kMaxPendingUrbs;
  static constexpr std::size_t kMaxUnsentBytes = UsbipClient::kMaxUnsentBytes;
  static constexpr std::size_t kMaxReadPerFrame = UsbipClient::kMaxReadPerFrame;

  struct Statistics {
    std::uint64_t connections = 0;  ///< accepted
    std::array<std::uint64_t, static_cast<std::size_t>(CloseReason::kCount)> closed{};
    rt::Scheduling scheduling;  ///< of the frame thread; `reason` says why it was refused

    [[nodiscard]] std::uint64_t closed_for(CloseReason reason) const noexcept {
      return closed[static_cast<std::size_t>(reason)];
    }
  };

  /// One device of the server, seen from outside.
  class DeviceHandle {
   public:
    [[nodiscard]] const std::string& busid() const;
    [[nodiscard]] EmulatorReport report() const;
    /// Newest counter samples with their true times, oldest first.
    [[nodiscard]] std::vector<CounterSample> samples() const;
    /// Pulls the cable: the client's connection closes at once, the device is not listed and can't
    /// be imported until replug(). Its power stays on.
    void unplug();
    void replug();
    void press_calibration_button();

   private:
    friend class EmulatorServer;
    DeviceHandle(EmulatorServer& server, std::size_t index) : server_(&server), index_(index) {}
    EmulatorServer* server_;
    std::size_t index_;
  };

  /// Binds and listens; clients may connect from now on and are served from start() on.
  /// @throws EmulatorError when the address can't be used (not loopback, port in use), nor the
  ///         hands' socket, when there is no device or when a frame period is of no bus speed;
  ///         std::invalid_argument for a profile that can't be emulated.
  explicit EmulatorServer(const ServerOptions& options);
  ~EmulatorServer();
  EmulatorServer(const EmulatorServer&) = delete;
  EmulatorServer& operator=(const EmulatorServer&) = delete;

  /// Starts the frame thread and waits until its scheduling is settled. Once.
  void start();
  /// Closes every connection and joins the frame thread. Idempotent. Reports stay readable.
  void stop() noexcept;

  [[nodiscard]] std::uint16_t port() const noexcept;
  /// "127.0.0.1:41234".
  [[nodiscard]] std::string address() const;
  [[nodiscard]] std::size_t device_count() const noexcept;
  /// @throws std::out_of_range beyond device_count().
  [[nodiscard]] DeviceHandle device(std::size_t index = 0);
  [[nodiscard]] EmulatorReport report(std::size_t index = 0) const;
  [[nodiscard]] Statistics statistics() const;

 private:
  struct [[gnu::visibility("hidden")]] Impl;
  std::unique_ptr<Impl> impl_;
};

#pragma GCC visibility pop
}  // namespace forcegrid::emulator
