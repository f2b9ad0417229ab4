// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "device_emulator/close_reason.h"
#include "device_emulator/emulated_device.h"
#include "device_emulator/listen_socket.h"
#include "device_emulator/urb_host.h"
#include "device_emulator/usbip_wire.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// A port of the emulated bus with the device that is plugged into it.
struct BusPort {
  std::unique_ptr<EmulatedDevice> device;
  usbip::DeviceInfo info;
  bool attached = false;   ///< imported by a client
  bool unplugged = false;  ///< by EmulatorServer::DeviceHandle::unplug()

  [[nodiscard]] bool available() const noexcept { return !unplugged && device->plugged_in(); }
  [[nodiscard]] bool has_bulk_endpoint() const noexcept;
  /// Null: the device has no such endpoint.
  [[nodiscard]] const UsbEndpoint* endpoint(std::uint8_t address) const noexcept;
};

/// One USB/IP client of the emulator: its input, its pending output, the device that it has
/// imported and the transfers (URBs) that wait for that device.
///
/// A client first asks for the list of devices or imports one (operations); after an import it
/// submits and unlinks transfers (commands). A message that the protocol does not allow closes the
/// connection with its CloseReason; nothing that a client sends blocks.
///
/// Real-time: no (lists grow). Threads: one at a time.
class UsbipClient {
 public:
  static constexpr std::size_t kMaxPendingUrbs = 256;
  static constexpr std::size_t kMaxUnsentBytes = 512 * 1024;
  static constexpr std::size_t kMaxReadPerFrame = 80 * 1024;

  UsbipClient(FileDescriptor socket, rt::TimePoint opened) noexcept
      : socket_(std::move(socket)), opened_(opened) {}

  /// Reads what the client has sent, at most `buffer.size()` bytes and 64 messages. Control
  /// transfers and unlinks are answered at once.
  void receive(std::span<BusPort> ports, std::span<std::uint8_t> buffer, rt::TimePoint now);
  /// Runs the imported device's `port` with the pending transfers.
  void run_device(BusPort& port, rt::TimePoint now);
  /// Sends what the socket accepts without waiting. Closes a client with kMaxUnsentBytes unread.
  void send();

  /// Marks the connection as closing; the first reason is kept.
  void close(CloseReason reason) noexcept {
    if (!closing_) {
      closing_ = reason;
    }
  }
  /// The same; also drops what has not been sent yet.
  void cut_off(CloseReason reason) noexcept {
    unsent_.clear();
    close(reason);
  }
  /// Closes the socket. The imported device gets a bus reset and is free for the next client.
  void release(std::span<BusPort> ports, rt::TimePoint now);

  [[nodiscard]] int socket() const noexcept { return socket_.get(); }
  [[nodiscard]] bool released() const noexcept { return socket_.get() < 0; }
  [[nodiscard]] rt::TimePoint opened() const noexcept { return opened_; }
  /// Index of the imported device; nothing before an import.
  [[nodiscard]] const std::optional<std::size_t>& device() const noexcept { return device_; }
  [[nodiscard]] const std::optional<CloseReason>& closing() const noexcept { return closing_; }
  [[nodiscard]] bool waits_for_transfer() const noexcept { return !urbs_.empty(); }
  [[nodiscard]] bool waits_for_reply() const noexcept { return !unsent_.empty(); }

 private:
  /// @returns bytes consumed; 0 when the message is not complete or the connection is closing.
  std::size_t take_operation(std::span<BusPort> ports, std::span<const std::uint8_t> bytes);
  std::size_t take_command(BusPort& port, std::span<const std::uint8_t> bytes, rt::TimePoint now);
  void import(std::span<BusPort> ports, std::string_view busid);
  void submit(BusPort& port, const usbip::Command& command, std::span<const std::uint8_t> data,
              rt::TimePoint now);
  void control(BusPort& port, const usbip::Command& command, std::span<const std::uint8_t> data,
               rt::TimePoint now);
  void unlink(const usbip::Command& command);

  FileDescriptor socket_;
  rt::TimePoint opened_;
  std::vector<std::uint8_t> received_;
  std::vector<std::uint8_t> unsent_;
  std::optional<std::size_t> device_;
  std::vector<Urb> urbs_;
  std::optional<CloseReason> closing_;
};

/// Runs one frame of a device that no client has imported.
void run_without_client(EmulatedDevice& device, rt::TimePoint now);

}  // namespace forcegrid::emulator
