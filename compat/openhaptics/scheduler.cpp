// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/scheduler.h"

#include <pthread.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <exception>

#include "compat/openhaptics/error_stack.h"
#include "rt/thread.h"

namespace forcegrid::openhaptics {
namespace {

using rt::Clock;

constexpr int kSchedulerPriority = rt::kServoPriority - 10;  // below the motor threads
constexpr HDSchedulerHandle kLargestHandle = 0x7FFFFFFF;
constexpr double kRateSmoothing = 1.0 / 256.0;

// 0: not a servo thread.
thread_local constinit std::uint64_t my_generation = 0;

std::int64_t to_ns(rt::TimePoint time) noexcept {
  return std::chrono::nanoseconds(time.time_since_epoch()).count();
}

void complain(const char* what) noexcept {
  std::fprintf(stderr, "forcegrid: a callback threw and is not called again: %s\n", what);
  push_error(HD_INVALID_OPERATION, 0, ECANCELED);
}

// Returns its answer. The end of its thread, by pthread_exit() or when Python ends, goes on.
HDCallbackCode guarded(HDSchedulerCallback callback, void* data) {
  try {
    return callback(data);
  } catch (const std::exception& error) {
    complain(error.what());
  } catch (...) {
    if (!std::current_exception()) {  // no exception of C++: the thread ends
      throw;
    }
    complain("an exception that says nothing");
  }
  return HD_CALLBACK_DONE;
}

struct ThreadStart {
  Scheduler* scheduler;
  std::uint64_t generation;
};

}  // namespace

Scheduler::Scheduler(TickClient& client) : client_(client) { entries_.reserve(kMaxEntries); }

bool Scheduler::in_servo_thread() noexcept { return my_generation != 0; }

bool Scheduler::runs_before(const Entry& a, const Entry& b) noexcept {
  return a.priority != b.priority ? a.priority > b.priority : a.number < b.number;
}

bool Scheduler::start() noexcept {
  std::unique_lock lock(mutex_);
  if (running_) {
    return true;
  }
  if (in_servo_thread()) {  // stopped in this callback
    generation_ = my_generation;
    running_ = true;
    return true;
  }
  changed_.wait_until(mutex_, Clock::now() + kPatience, [this] { return threads_ == 0; });
  auto* const begin = new (std::nothrow) ThreadStart{this, ++generation_};
  pthread_t thread{};
  if (begin == nullptr || pthread_create(&thread, nullptr, thread_main, begin) != 0) {
    delete begin;
    return false;
  }
  pthread_detach(thread);
  ++threads_;
  mean_period_s_ = 0.0;
  running_ = true;
  return true;
}

bool Scheduler::stop(rt::Duration patience) noexcept {
  std::unique_lock lock(mutex_);
  if (running_) {
    running_ = false;
    ++generation_;
  }
  changed_.wake_all();
  if (in_servo_thread()) {
    return true;
  }
  return changed_.wait_until(mutex_, Clock::now() + patience,
                             [this] { return threads_ == 0 || running_; });
}

bool Scheduler::set_rate(double rate_Hz) noexcept {
  if (!(rate_Hz >= kMinRate_Hz && rate_Hz <= kMaxRate_Hz)) {
    return false;
  }
  rate_Hz_ = rate_Hz;
  mean_period_s_ = 0.0;
  return true;
}

double Scheduler::measured_rate_Hz() const noexcept {
  const double period_s = mean_period_s_;
  return running_ && period_s > 0.0 ? 1.0 / period_s : rate_Hz_.load();
}

double Scheduler::seconds_in_tick() const noexcept {
  const std::int64_t began_ns = tick_began_ns_;
  return running_ && began_ns != 0 ? 1e-9 * static_cast<double>(to_ns(Clock::now()) - began_ns)
                                   : 0.0;
}

bool Scheduler::add(Entry& entry) {
  if (entries_.size() >= kMaxEntries) {
    return false;
  }
  entry.number = ++next_number_;
  entry.handle = 1 + (entry.number - 1) % kLargestHandle;
  entries_.insert(std::upper_bound(entries_.begin(), entries_.end(), entry, runs_before), entry);
  return true;
}

std::vector<Scheduler::Entry>::iterator Scheduler::find(HDSchedulerHandle handle) noexcept {
  return std::find_if(entries_.begin(), entries_.end(),
                      [handle](const Entry& one) { return one.handle == handle; });
}

HDSchedulerHandle Scheduler::asynchronous(HDSchedulerCallback callback, void* data,
                                          HDushort priority) noexcept {
  const std::lock_guard lock(mutex_);
  Entry entry{.callback = callback, .data = data, .priority = priority};
  return add(entry) ? entry.handle : 0;
}

bool Scheduler::synchronous(HDSchedulerCallback callback, void* data, HDushort priority) {
  if (in_servo_thread()) {
    guarded(callback, data);
    return true;
  }
  {
    std::unique_lock lock(mutex_);
    if (running_) {
      Call call;
      Entry entry{.callback = callback, .data = data, .call = &call, .priority = priority};
      if (!add(entry)) {
        return false;
      }
      changed_.wait(mutex_, [&] { return call.done || (!running_ && executing_ != entry.handle); });
      if (call.done) {
        return true;
      }
      entries_.erase(find(entry.handle));
    }
  }
  const std::lock_guard one_at_a_time(alone_);
  guarded(callback, data);
  return true;
}

bool Scheduler::unschedule(HDSchedulerHandle handle) noexcept {
  const std::lock_guard lock(mutex_);
  const auto entry = find(handle);
  if (entry != entries_.end() && entry->call == nullptr) {
    entries_.erase(entry);
    changed_.wake_all();
  }
  if (handle == 0 || in_servo_thread()) {
    return true;
  }
  return changed_.wait_until(mutex_, Clock::now() + kPatience,
                             [&] { return executing_ != handle; });
}

bool Scheduler::is_scheduled(HDSchedulerHandle handle) noexcept {
  const std::lock_guard lock(mutex_);
  return find(handle) != entries_.end();
}

void Scheduler::wait_for(HDSchedulerHandle handle) noexcept {
  const std::lock_guard lock(mutex_);
  if (!in_servo_thread()) {
    changed_.wait(mutex_, [&] { return !running_ || find(handle) == entries_.end(); });
  }
}

void* Scheduler::thread_main(void* argument) {
  const ThreadStart begin = *static_cast<ThreadStart*>(argument);
  delete static_cast<ThreadStart*>(argument);
  Scheduler& self = *begin.scheduler;
  // Also when a callback ends its own thread.
  struct End {
    Scheduler& self;
    std::uint64_t generation;
    ~End() {
      const std::lock_guard lock(self.mutex_);
      --self.threads_;
      if (self.generation_ == generation) {
        self.running_ = false;
      }
      self.changed_.wake_all();
    }
  } const end{self, begin.generation};
  my_generation = begin.generation;
  rt::name_current_thread("hd scheduler");
  rt::make_current_thread_realtime(kSchedulerPriority);
  self.run(begin.generation);
  return nullptr;
}

void Scheduler::run(std::uint64_t generation) {
  rt::TimePoint due = Clock::now();
  rt::TimePoint before{};
  while (true) {
    {
      const std::lock_guard lock(mutex_);
      if (generation_ != generation) {
        return;
      }
    }
    const rt::TimePoint now = Clock::now();
    if (before != rt::TimePoint{}) {
      const double old_s = mean_period_s_;
      const double mean_s = old_s > 0.0 ? old_s : 1.0 / rate_Hz_;
      mean_period_s_ = mean_s + kRateSmoothing * (rt::seconds(now - before) - mean_s);
    }
    before = now;
    tick_began_ns_ = to_ns(now);
    client_.tick_begins();
    run_tick(generation);
    client_.tick_ended();
    wait_for_next_tick(due);
  }
}

void Scheduler::run_tick(std::uint64_t generation) {
  std::unique_lock lock(mutex_);
  const std::uint64_t newest = next_number_;
  Entry last{.priority = HD_MAX_SCHEDULER_PRIORITY};
  while (generation_ == generation) {
    auto next = std::upper_bound(entries_.begin(), entries_.end(), last, runs_before);
    next = std::find_if(next, entries_.end(),
                        [newest](const Entry& one) { return one.number <= newest; });
    if (next == entries_.end()) {
      return;
    }
    last = *next;
    run_entry(lock, last);
  }
}

void Scheduler::run_entry(std::unique_lock<PriorityMutex>& lock, Entry entry) {
  executing_ = entry.handle;
  lock.unlock();
  client_.callback_begins();
  // Unwinding, the thread ends, and with it what it was doing.
  struct Leave {
    Scheduler& self;
    const Entry& entry;
    std::unique_lock<PriorityMutex>& lock;
    const rt::TimePoint began;
    bool again = false;
    ~Leave() {
      const bool recurring = entry.call == nullptr && (again || entry.has_run);
      self.client_.callback_ended(recurring, Clock::now() - began);
      lock.lock();
      self.end_entry(entry, again);
    }
  } leave{*this, entry, lock, Clock::now()};
  leave.again =
      guarded(entry.callback, entry.data) == HD_CALLBACK_CONTINUE && entry.call == nullptr;
}

void Scheduler::end_entry(const Entry& entry, bool again) noexcept {
  executing_ = 0;
  const auto found = std::lower_bound(entries_.begin(), entries_.end(), entry, runs_before);
  if (found != entries_.end() && found->number == entry.number) {
    found->has_run = true;
    if (!again) {
      entries_.erase(found);
    }
  }
  if (entry.call != nullptr) {
    entry.call->done = true;
  }
  changed_.wake_all();
}

void Scheduler::wait_for_next_tick(rt::TimePoint& due) noexcept {
  const double rate_Hz = rate_Hz_;
  const rt::Duration period = rt::from_seconds(1.0 / rate_Hz);
  const rt::TimePoint began{std::chrono::nanoseconds(tick_began_ns_)};
  const auto waited = client_.wait_for_device(rate_Hz, began + period + period / 2);
  if (waited == TickClient::Wait::kCycle) {
    due = Clock::now();
    return;
  }
  due += period;
  if (Clock::now() - due > 10 * period) {
    due = Clock::now();  // ticks that were missed are not made up for
  }
  rt::sleep_until(due);
}

}  // namespace forcegrid::openhaptics
