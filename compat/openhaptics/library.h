// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hdDefines.h>

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "compat/openhaptics/arm.h"
#include "compat/openhaptics/device_table.h"
#include "compat/openhaptics/priority_mutex.h"
#include "compat/openhaptics/scheduler.h"

namespace forcegrid::openhaptics {

/// All that libHD knows: open devices, which one is current, and the scheduler. There is one, which
/// is never destroyed, since programs call from atexit() and from destructors of static objects.
///
/// Functions push their errors for the calling thread. Threads: any, from callbacks too.
/// Real-time: all but open(), close(), start(), stop() and update_calibration().
class Library final : public TickClient {
 public:
  static constexpr std::size_t kMostArms = 16;

  static Library& instance();
  ~Library() override = default;
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  [[nodiscard]] Scheduler& scheduler() noexcept { return scheduler_; }

  /// @returns its handle, or HD_INVALID_HANDLE and an error.
  HHD open(const char* name);
  void close(HHD handle);
  [[nodiscard]] HHD current() const noexcept { return current_; }
  void make_current(HHD handle) noexcept;

  void begin_frame(HHD handle) noexcept;
  void end_frame(HHD handle) noexcept;

  /// @param values room for kMostValues; zeros (a transform: the identity) without a device.
  void read(const Parameter& parameter, double* values) noexcept;
  void set(const Parameter& parameter, const double* values) noexcept;
  const char* text(HDenum name) noexcept;

  void enable(HDenum capability, bool on) noexcept;
  [[nodiscard]] bool is_enabled(HDenum capability) noexcept;

  [[nodiscard]] HDenum calibration() noexcept;
  void update_calibration();

  void start();
  void stop(rt::Duration patience = Scheduler::kPatience);

  void tick_begins() noexcept override;
  void callback_begins() noexcept override;
  void callback_ended(bool recurring, rt::Duration took) noexcept override;
  void tick_ended() noexcept override;
  Wait wait_for_device(double rate_Hz, rt::TimePoint deadline) noexcept override;

 private:
  Library() : scheduler_(*this) {}

  /// With mutex_ held; null and HD_BAD_HANDLE if there is no such device.
  Arm* arm(HHD handle) noexcept;
  Arm* current_arm() noexcept { return arm(current_); }
  [[nodiscard]] const Arm* opened(const DeviceEntry& entry) const noexcept;
  std::shared_ptr<session::DeviceSession> open_session(const DeviceEntry& entry, HHD handle);
  void close_at_exit() noexcept;

  std::mutex opening_;  ///< one at a time; taken before mutex_
  PriorityMutex mutex_;
  std::array<std::unique_ptr<Arm>, kMostArms> arms_;
  std::atomic<HHD> current_{0};
  bool closes_at_exit_ = false;
  std::string method_;                           ///< FORCEGRID_HD_METHOD at the first opening
  std::weak_ptr<session::DeviceSession> pacer_;  ///< servo thread: whose cycles begin its ticks
  std::uint64_t seen_cycle_ = 0;                 ///< servo thread
  Scheduler scheduler_;
};

}  // namespace forcegrid::openhaptics
