// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>

#include "driver/device.h"
#include "driver/open_device.h"
#include "driver/transport.h"
#include "rt/mailbox.h"
#include "rt/thread.h"

namespace forcegrid::driver {

/// What drivers that exchange packets on an I/O thread of their own share: the thread's life, the
/// mailboxes and counters between it and the servo, and what becomes of a fault. The exchange
/// itself is the derived class's: it implements run() and finish(), calls start_thread() at the end
/// of its constructor, and stop() in its destructor.
class IoThreadDevice : public Device {
 public:
  [[nodiscard]] const DeviceIdentity& identity() const noexcept override { return identity_; }
  [[nodiscard]] DeviceReport newest_report() noexcept override;
  void command(const MotorCommand& command) noexcept override;
  /// The I/O thread can be held by the kernel, so silence is noticed here, too.
  [[nodiscard]] DeviceHealth health() const noexcept override;
  [[nodiscard]] DeviceStatistics statistics() const noexcept override;
  [[nodiscard]] std::string failure() const override;
  bool stop() noexcept override;

 protected:
  /// What the servo hands over, with the time it did.
  struct IssuedCommand {
    MotorCommand command;
    rt::TimePoint issued{};
  };

  /// Counters that one thread writes and any thread reads; see DeviceStatistics.
  struct AtomicStatistics {
    std::atomic<std::uint64_t> reports_received{0};
    std::atomic<std::uint64_t> reports_rejected{0};
    std::atomic<std::uint64_t> reports_drained{0};
    std::atomic<std::uint64_t> reports_discarded{0};
    std::atomic<std::uint64_t> reports_lost{0};
    std::atomic<std::uint64_t> reports_late{0};
    std::atomic<std::uint64_t> reports_unasked{0};
    std::atomic<std::uint64_t> commands_sent{0};
    std::atomic<std::uint64_t> kicks{0};
    std::atomic<std::uint64_t> commands_starved{0};
    std::atomic<std::uint64_t> commands_not_finite{0};
    std::atomic<std::uint64_t> commands_clamped{0};
    std::atomic<std::uint64_t> refreshes{0};
  };

  /// @param no_report  words for silence, e.g. "no report for"; the time follows
  /// @param remedy     what the person can do about it
  IoThreadDevice(const OpenOptions& options, DeviceIdentity identity, std::string no_report,
                 std::string remedy);

  /// Starts the thread, real-time if the options say so, and notices a refusal.
  /// @throws std::system_error when there is no thread to be had.
  void start_thread();

  /// The exchange. On the I/O thread, until stopping() or a fault, which it has to follow with zero
  /// current; ends with finish().
  virtual void run() noexcept = 0;
  /// The last zero, then the end of the transport, see closed(). On the I/O thread, or on the
  /// opening thread where there is none.
  virtual void finish() noexcept = 0;
  /// Ends a wait of run(). Real-time: one non-blocking call at most.
  virtual void wake_up() const noexcept {}

  static void count(std::atomic<std::uint64_t>& counter) noexcept {
    counter.fetch_add(1, std::memory_order_relaxed);
  }
  [[nodiscard]] bool stopping() const noexcept {
    return stop_requested_.load(std::memory_order_acquire);
  }
  [[nodiscard]] bool running() const noexcept {
    return health_.load(std::memory_order_acquire) == DeviceHealth::kRunning;
  }
  [[nodiscard]] bool silent(rt::TimePoint now) const noexcept;
  [[nodiscard]] std::string stale_words() const;

  /// The first fault counts, and its words.
  void fail(DeviceHealth health, const std::string& words) noexcept;
  /// The transport has ended with `status`, which is the fault, in its own words.
  void fail_with(TransportStatus status, const std::string& words) noexcept;
  static bool usable(TransportStatus status) noexcept {
    return status == TransportStatus::kOk || status == TransportStatus::kTimeout;
  }
  /// The handle is closed.
  void closed() noexcept;
  /// Gives a report to the servo.
  void publish_report(const DeviceReport& report) noexcept;

  const OpenOptions options_;
  const DeviceIdentity identity_;
  AtomicStatistics statistics_;
  rt::Mailbox<IssuedCommand> commands_;
  bool zero_delivered_ = false;  ///< of the I/O thread; read after it has been joined

 private:
  const std::string no_report_;
  const std::string remedy_;
  rt::Mailbox<DeviceReport> reports_;
  DeviceReport report_for_servo_;             ///< set-up and servo thread
  std::atomic<std::int64_t> last_report_{0};  ///< the clock's ticks
  mutable std::atomic<DeviceHealth> health_{DeviceHealth::kRunning};
  std::atomic<bool> stop_requested_{false};
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::mutex stop_mutex_;
  bool stopped_ = false;
  std::thread thread_;
};

/// @throws DeviceError where a device's numbers are not those of its profile.
void check_ids(const TransportIdentity& identity, const profiles::DeviceProfile& profile,
               const std::string& url);

}  // namespace forcegrid::driver
