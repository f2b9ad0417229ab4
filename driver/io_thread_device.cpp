// SPDX-License-Identifier: Apache-2.0
#include "driver/io_thread_device.h"

#include <cstdio>
#include <future>
#include <utility>

namespace forcegrid::driver {

IoThreadDevice::IoThreadDevice(const OpenOptions& options, DeviceIdentity identity,
                               std::string no_report, std::string remedy)
    : options_(options),
      identity_(std::move(identity)),
      no_report_(std::move(no_report)),
      remedy_(std::move(remedy)) {}

void IoThreadDevice::start_thread() {
  std::promise<rt::Scheduling> promise;
  std::future<rt::Scheduling> scheduling = promise.get_future();
  thread_ = std::thread([this, promise = std::move(promise)]() mutable {
    rt::name_current_thread("fg-device-io");
    promise.set_value(options_.realtime_io ? rt::make_current_thread_realtime(rt::kDeviceIoPriority)
                                           : rt::Scheduling{});
    run();
  });
  const rt::Scheduling granted = scheduling.get();
  if (options_.realtime_io && !granted.realtime && options_.notice) {
    options_.notice("device I/O thread: " + granted.reason);
  }
}

DeviceReport IoThreadDevice::newest_report() noexcept {
  static_cast<void>(reports_.fetch(report_for_servo_));
  return report_for_servo_;
}

void IoThreadDevice::command(const MotorCommand& command) noexcept {
  commands_.publish({command, rt::Clock::now()});
  wake_up();
}

DeviceHealth IoThreadDevice::health() const noexcept {
  DeviceHealth health = health_.load(std::memory_order_acquire);
  if (health == DeviceHealth::kRunning && silent(rt::Clock::now())) {
    health_.compare_exchange_strong(health, DeviceHealth::kStale, std::memory_order_acq_rel);
    health = health_.load(std::memory_order_acquire);
  }
  return health;
}

DeviceStatistics IoThreadDevice::statistics() const noexcept {
  const auto value = [](const std::atomic<std::uint64_t>& counter) {
    return counter.load(std::memory_order_relaxed);
  };
  return {.reports_received = value(statistics_.reports_received),
          .reports_rejected = value(statistics_.reports_rejected),
          .reports_drained = value(statistics_.reports_drained),
          .reports_discarded = value(statistics_.reports_discarded),
          .reports_lost = value(statistics_.reports_lost),
          .reports_late = value(statistics_.reports_late),
          .reports_unasked = value(statistics_.reports_unasked),
          .commands_sent = value(statistics_.commands_sent),
          .kicks = value(statistics_.kicks),
          .commands_starved = value(statistics_.commands_starved),
          .commands_not_finite = value(statistics_.commands_not_finite),
          .commands_clamped = value(statistics_.commands_clamped),
          .refreshes = value(statistics_.refreshes)};
}

std::string IoThreadDevice::failure() const {
  const DeviceHealth now = health();
  if (now == DeviceHealth::kRunning) {
    return "";
  }
  {
    const std::lock_guard lock(failure_mutex_);
    if (!failure_.empty()) {
      return failure_;
    }
  }
  return now == DeviceHealth::kClosed ? "device '" + identity_.url + "': closed; open it again"
                                      : stale_words();
}

bool IoThreadDevice::stop() noexcept {
  const std::lock_guard lock(stop_mutex_);
  if (thread_.joinable()) {
    stop_requested_.store(true, std::memory_order_release);
    wake_up();
    thread_.join();
  } else if (!stopped_) {
    finish();
  }
  stopped_ = true;
  return zero_delivered_;
}

bool IoThreadDevice::silent(rt::TimePoint now) const noexcept {
  const rt::TimePoint last{rt::Duration(last_report_.load(std::memory_order_acquire))};
  return now - last > options_.stale_after;
}

std::string IoThreadDevice::stale_words() const {
  using std::chrono::milliseconds;
  return "device '" + identity_.url + "': " + no_report_ + " " +
         std::to_string(std::chrono::duration_cast<milliseconds>(options_.stale_after).count()) +
         " ms; " + remedy_;
}

void IoThreadDevice::fail(DeviceHealth health, const std::string& words) noexcept {
  {
    const std::lock_guard lock(failure_mutex_);
    if (failure_.empty()) {
      failure_ = words;
    }
  }
  DeviceHealth expected = DeviceHealth::kRunning;
  health_.compare_exchange_strong(expected, health, std::memory_order_acq_rel);
}

void IoThreadDevice::fail_with(TransportStatus status, const std::string& words) noexcept {
  fail(status == TransportStatus::kDisconnected ? DeviceHealth::kUnplugged
       : status == TransportStatus::kTaken      ? DeviceHealth::kTaken
                                                : DeviceHealth::kProtocol,
       words);
}

void IoThreadDevice::closed() noexcept {
  DeviceHealth expected = DeviceHealth::kRunning;
  health_.compare_exchange_strong(expected, DeviceHealth::kClosed, std::memory_order_acq_rel);
}

void IoThreadDevice::publish_report(const DeviceReport& report) noexcept {
  last_report_.store(report.received.time_since_epoch().count(), std::memory_order_release);
  count(statistics_.reports_received);
  reports_.publish(report);
}

void check_ids(const TransportIdentity& identity, const profiles::DeviceProfile& profile,
               const std::string& url) {
  if (identity.vendor_id == profile.usb.vendor_id &&
      identity.product_id == profile.usb.product_id) {
    return;
  }
  char ids[64];
  std::snprintf(ids, sizeof ids, "it is %04x:%04x where profile '", identity.vendor_id,
                identity.product_id);
  char wanted[16];
  std::snprintf(wanted, sizeof wanted, "%04x:%04x", profile.usb.vendor_id, profile.usb.product_id);
  throw DeviceError("device '" + url + "': " + ids + profile.name + "' has " + wanted +
                    "; name another device or profile");
}

}  // namespace forcegrid::driver
