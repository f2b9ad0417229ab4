// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rt/clock.h"

namespace forcegrid::driver {

enum class TransportStatus : std::uint8_t {
  kOk,
  kTimeout,       ///< nothing within the time given; the transport is still usable
  kDisconnected,  ///< the device or its server is gone; the transport is not usable any more
  kTaken,         ///< another program took the device, which is still there; not usable any more
  kProtocol,      ///< the other end broke the transport's rules; not usable any more
};

struct ReadResult {
  TransportStatus status = TransportStatus::kTimeout;
  std::size_t bytes = 0;  ///< of the report; one longer than the buffer is reported as its size
  rt::TimePoint arrived{};
};

/// What ended Transport::wait().
enum class WaitEnd : std::uint8_t {
  kReport,  ///< read() has a report or a failure
  kOther,   ///< the other descriptor can be read
  kTimeout,
};

struct WriteResult {
  TransportStatus status = TransportStatus::kTimeout;
  rt::TimePoint completed{};  ///< when the device had taken the report
};

struct TransportIdentity {
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::string manufacturer;
  std::string product;
  std::string serial;
};

/// Moves HID reports to and from one opened device. Constructors open and throw DeviceError.
/// Time-outs are durations: zero means "do not wait", and there is no "for ever".
/// Threads: one at a time; failure() is for that thread, too.
class Transport {
 public:
  virtual ~Transport() = default;
  Transport(const Transport&) = delete;
  Transport& operator=(const Transport&) = delete;

  virtual const TransportIdentity& identity() const noexcept = 0;
  virtual const std::vector<std::uint8_t>& report_descriptor() const noexcept = 0;

  /// The oldest report that has not been read.
  /// Real-time: no allocation or lock while the status is kOk or kTimeout.
  [[nodiscard]] virtual ReadResult read(std::span<std::uint8_t> buffer,
                                        rt::Duration timeout) noexcept = 0;

  /// Whether wait() can be used.
  virtual bool can_wait() const noexcept = 0;

  /// Waits for a report and for `descriptor` at once. A transport that cannot do so
  /// returns kTimeout at once.
  /// Real-time: as read().
  [[nodiscard]] virtual WaitEnd wait(int descriptor, rt::Duration timeout) noexcept = 0;

  /// Sends one report and waits until the device has taken it. After kTimeout the report is
  /// withdrawn where the transport can do that.
  /// Real-time: as read(), but a kernel's own wait may outlast `timeout` (hidraw: 5 s).
  [[nodiscard]] virtual WriteResult write(std::span<const std::uint8_t> report,
                                          rt::Duration timeout) noexcept = 0;

  /// Idempotent; every destructor calls it.
  virtual void close() noexcept = 0;

  /// One sentence about the last kDisconnected or kProtocol, with the system's words; else empty.
  virtual const std::string& failure() const noexcept = 0;

 protected:
  Transport() = default;
};

}  // namespace forcegrid::driver
