// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hdDefines.h>

#include <atomic>
#include <cstdint>
#include <mutex>
#include <vector>

#include "compat/openhaptics/priority_mutex.h"
#include "rt/clock.h"

namespace forcegrid::openhaptics {

/// What happens around the callbacks. All functions are called by the servo thread.
class TickClient {
 public:
  virtual ~TickClient() = default;
  virtual void tick_begins() noexcept = 0;
  virtual void callback_begins() noexcept = 0;
  /// @param recurring the callback runs in every tick. @param took how long it ran.
  virtual void callback_ended(bool recurring, rt::Duration took) noexcept = 0;
  virtual void tick_ended() noexcept = 0;

  enum class Wait : std::uint8_t { kCycle, kTimeout, kNoDevice };
  /// Waits for the next cycle of a device that runs at `rate_Hz`, or until `deadline`.
  /// kNoDevice, at once: there is none.
  virtual Wait wait_for_device(double rate_Hz, rt::TimePoint deadline) noexcept = 0;
};

/// One thread that runs callbacks, tick by tick, in falling priority, equal ones in the order in
/// which they were scheduled. A tick runs what was scheduled before it began. With a device that
/// has the scheduler's rate a tick begins with the device's cycle, else at an absolute deadline.
///
/// The thread asks for SCHED_FIFO below the motor threads, so that no callback can keep them from
/// a core. A callback that throws counts as done.
///
/// Threads: every function from any thread, from callbacks too. Real-time: the thread itself
/// allocates nothing; a callback that schedules may.
class Scheduler {
 public:
  static constexpr double kMinRate_Hz = 500;
  static constexpr double kMaxRate_Hz = 4000;
  static constexpr std::size_t kMaxEntries = 8192;
  static constexpr std::chrono::seconds kPatience{2};  ///< with a callback that does not return

  explicit Scheduler(TickClient& client);
  /// Never destroyed while it runs.
  ~Scheduler() = default;
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// Idempotent. @returns false if the thread can't be started.
  bool start() noexcept;
  /// Returns when no callback runs any more; from a callback at once, and the tick ends with it.
  /// Idempotent. @returns false if a callback has not returned within `patience`: its thread is
  /// left alone and runs no other callback.
  bool stop(rt::Duration patience = kPatience) noexcept;
  [[nodiscard]] bool running() const noexcept { return running_; }

  /// @returns false out of range.
  bool set_rate(double rate_Hz) noexcept;
  [[nodiscard]] double rate_Hz() const noexcept { return rate_Hz_; }
  /// [Hz] Of the last quarter of a second or so; the set rate before the
  /// first tick and when it does not run.
  [[nodiscard]] double measured_rate_Hz() const noexcept;
  /// Since the start of the present tick; 0 when it does not run.
  [[nodiscard]] double seconds_in_tick() const noexcept;

  /// @returns 1 to 0x7FFFFFFF; 0: full.
  HDSchedulerHandle asynchronous(HDSchedulerCallback callback, void* data,
                                 HDushort priority) noexcept;
  /// Returns after one run in the servo thread; in the caller's thread if that is the servo thread
  /// or if the scheduler does not run. @returns false: full.
  bool synchronous(HDSchedulerCallback callback, void* data, HDushort priority);
  /// Unknown handles are ignored. Returns when it does not run any more, see stop().
  /// @returns false if it did not return.
  bool unschedule(HDSchedulerHandle handle) noexcept;
  [[nodiscard]] bool is_scheduled(HDSchedulerHandle handle) noexcept;
  /// Waits until it is not scheduled any more. Returns at once from a callback, and when the
  /// scheduler does not run or stops.
  void wait_for(HDSchedulerHandle handle) noexcept;

  /// Whether the calling thread is a servo thread.
  static bool in_servo_thread() noexcept;

 private:
  struct Call {  ///< of a thread that waits for synchronous()
    bool done = false;
  };
  struct Entry {
    HDSchedulerCallback callback = nullptr;
    void* data = nullptr;
    Call* call = nullptr;  ///< synchronous
    std::uint64_t number = 0;
    HDSchedulerHandle handle = 0;
    HDushort priority = 0;
    bool has_run = false;
  };
  static bool runs_before(const Entry& a, const Entry& b) noexcept;

  bool add(Entry& entry);
  std::vector<Entry>::iterator find(HDSchedulerHandle handle) noexcept;
  void run(std::uint64_t generation);
  void run_tick(std::uint64_t generation);
  void run_entry(std::unique_lock<PriorityMutex>& lock, Entry entry);
  void end_entry(const Entry& entry, bool again) noexcept;
  void wait_for_next_tick(rt::TimePoint& due) noexcept;
  static void* thread_main(void* argument);

  TickClient& client_;
  PriorityMutex mutex_;
  Condition changed_;
  std::vector<Entry> entries_;  ///< in the order in which they run
  std::uint64_t next_number_ = 0;
  std::uint64_t generation_ = 0;  ///< of the thread that may run callbacks
  int threads_ = 0;               ///< that have not ended
  HDSchedulerHandle executing_ = 0;
  std::atomic<bool> running_{false};
  std::atomic<double> rate_Hz_{1000.0};
  std::atomic<double> mean_period_s_{0.0};  ///< 0: not measured yet
  std::atomic<std::int64_t> tick_began_ns_{0};
  std::recursive_mutex alone_;  ///< of synchronous callbacks in their callers' threads
};

}  // namespace forcegrid::openhaptics
