// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "driver/bulk_transport.h"

namespace forcegrid::driver {

/// A Falcon at USB level for tests of the driver alone, written from the device's fact sheet: the
/// serial chip's requests and packets, the boot loader, and firmware that answers packets. What it
/// does wrong is scripted. Threads: any.
class ScriptedFalcon {
 public:
  enum class State { kCold, kAutobaud, kLoading, kRunning };

  struct Script {
    State state = State::kCold;  ///< to begin with
    bool answers_greeting = true;
    bool answers_autobaud = true;
    /// The boot loader ends the image and stays where it is.
    bool runs_what_it_loaded = true;
    std::optional<std::size_t> wrong_echo_at{};   ///< byte of the image
    std::optional<std::size_t> silent_from{};     ///< byte of the image: no echo from here on
    std::optional<std::size_t> unplugged_at{};    ///< byte of the image
    std::vector<std::uint8_t> before_greeting{};  ///< spurious bytes before the answer
    std::vector<std::uint8_t> before_packet{};    ///< bytes before each packet's '<'
    bool takes_requests = true;
  };

  explicit ScriptedFalcon(Script script);

  // The USB side. Nothing (false, or no packet) when it is unplugged.
  bool plugged() const { return plugged_; }
  bool control(const ControlRequest& request);
  bool out(std::span<const std::uint8_t> bytes);
  /// What the next IN token gets: the two status bytes with up to 62 bytes of data, if any.
  std::vector<std::uint8_t> in();

  // The test's side.
  void unplug() { plugged_ = false; }
  void set_counts(const std::array<std::int16_t, 3>& counts);
  void set_homed(std::uint8_t bits);
  void set_buttons(std::uint8_t bits);
  void set_answering(bool answering);
  /// So many of the next packets get no answer.
  void swallow(int packets);
  /// So many of the next packets get their answer twice.
  void repeat(int packets);
  /// From now on a packet gets the answer to the one before it.
  void fall_behind();
  /// Packets are lost from now on; what is owed is still answered.
  void set_deaf(bool deaf);
  State state() const;
  std::vector<ControlRequest> requests() const;
  /// Bytes of the image that the boot loader took.
  std::vector<std::uint8_t> image() const;
  /// Whole 16-byte packets that the firmware took, in order.
  std::vector<std::array<std::uint8_t, 16>> packets() const;
  /// Motor commands of the newest packet, decoded as the sheet says.
  std::array<int, 3> last_command() const;
  /// Byte 13 of the newest packet, less 0x41.
  int last_flags() const;
  /// Largest absolute command ever.
  int largest_command() const;

 private:
  double baud() const;
  void take(std::uint8_t byte);
  void take_image_byte(std::uint8_t byte);
  void take_packet_byte(std::uint8_t byte);
  bool image_is_complete() const;
  std::vector<std::uint8_t> reply() const;

  mutable std::mutex mutex_;
  Script script_;
  State state_;
  std::atomic<bool> plugged_{true};
  std::uint16_t divisor_value_ = 0;
  bool dtr_ = false;
  std::deque<std::uint8_t> heard_;  ///< last bytes in the cold state
  std::deque<std::uint8_t> answer_;
  std::vector<std::uint8_t> image_;
  std::vector<std::uint8_t> packet_;
  std::vector<std::array<std::uint8_t, 16>> packets_;
  std::vector<ControlRequest> requests_;
  std::array<std::int16_t, 3> counts_{};
  std::uint8_t homed_ = 0;
  std::uint8_t buttons_ = 0;
  bool answering_ = true;
  int swallow_ = 0;
  int repeat_ = 0;
  bool behind_ = false;
  bool deaf_ = false;
  std::vector<std::uint8_t> owed_;
  int largest_command_ = 0;
};

/// A transport that leads to a scripted Falcon, at the pace of its latency timer (1 ms).
class ScriptedBulkTransport final : public BulkTransport {
 public:
  explicit ScriptedBulkTransport(std::shared_ptr<ScriptedFalcon> falcon)
      : falcon_(std::move(falcon)) {}

  const TransportIdentity& identity() const noexcept override { return identity_; }
  const std::vector<std::uint8_t>& report_descriptor() const noexcept override { return none_; }
  ReadResult read(std::span<std::uint8_t> buffer, rt::Duration timeout) noexcept override;
  bool can_wait() const noexcept override { return false; }
  WaitEnd wait(int, rt::Duration) noexcept override { return WaitEnd::kTimeout; }
  WriteResult write(std::span<const std::uint8_t> bytes, rt::Duration timeout) noexcept override;
  TransportStatus control_out(const ControlRequest& request, rt::Duration) noexcept override;
  void close() noexcept override { closed_ = true; }
  const std::string& failure() const noexcept override { return failure_; }

 private:
  TransportStatus gone() noexcept;

  std::shared_ptr<ScriptedFalcon> falcon_;
  TransportIdentity identity_{0x0403, 0xCB48, "Novint", "FALCON HAPTIC", "FV001"};
  std::vector<std::uint8_t> none_;
  std::string failure_;
  bool closed_ = false;
};

}  // namespace forcegrid::driver
