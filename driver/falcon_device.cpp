#include "driver/falcon_device.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <future>
#include <mutex>
#include <thread>

#include "driver/falcon_codec.h"
#include "driver/ftdi_port.h"
#include "rt/mailbox.h"
#include "rt/thread.h"

namespace forcegrid::driver {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

// Then a reply counts as lost. USB loses none, so this is long enough for a host that is late.
constexpr rt::Duration kReplyTimeout = milliseconds(40);
// After a loss two replies may come: the latency timer, and a bus frame each way.
constexpr rt::Duration kSettleAfterLoss = milliseconds(3);
// A device that answers at once must not keep a real-time thread busy for ever.
constexpr rt::Duration kShortestExchange = microseconds(200);
constexpr rt::Duration kPollWhenFaulted = milliseconds(20);
constexpr int kLastZeroAttempts = 3;
constexpr int kMaxPacketsOfOneReply = 64;

struct IssuedCommand {
  MotorCommand command;
  rt::TimePoint issued{};
};

/// Counters that one thread writes and any thread reads.
struct AtomicStatistics {
  std::atomic<std::uint64_t> reports_received{0};
  std::atomic<std::uint64_t> reports_rejected{0};
  std::atomic<std::uint64_t> reports_drained{0};
  std::atomic<std::uint64_t> reports_lost{0};
  std::atomic<std::uint64_t> commands_sent{0};
  std::atomic<std::uint64_t> commands_starved{0};
  std::atomic<std::uint64_t> commands_not_finite{0};
  std::atomic<std::uint64_t> commands_clamped{0};
};

void count(std::atomic<std::uint64_t>& counter) noexcept {
  counter.fetch_add(1, std::memory_order_relaxed);
}

class FalconDevice final : public Device {
 public:
  FalconDevice(std::unique_ptr<BulkTransport> transport, const profiles::DeviceProfile& profile,
               const OpenOptions& options, const std::string& url,
               const falcon::StartupTiming& timing)
      : transport_(std::move(transport)),
        port_(*transport_, options.connect_timeout),
        parameters_(profile.falcon),
        options_(options),
        identity_{url, transport_->identity().manufacturer, transport_->identity().product,
                  transport_->identity().serial} {
    try {
      static_cast<void>(falcon::bring_up(
          port_, [this] { return transport_->failure(); }, url, options_.firmware, options_.notice,
          timing));
      exchanging_ = true;
      first_exchange();
      std::promise<rt::Scheduling> promise;
      std::future<rt::Scheduling> scheduling = promise.get_future();
      thread_ = std::thread([this, promise = std::move(promise)]() mutable {
        rt::name_current_thread("fg-device-io");
        promise.set_value(options_.realtime_io
                              ? rt::make_current_thread_realtime(rt::kDeviceIoPriority)
                              : rt::Scheduling{});
        run();
      });
      const rt::Scheduling granted = scheduling.get();
      if (options_.realtime_io && !granted.realtime && options_.notice) {
        options_.notice("device I/O thread: " + granted.reason);
      }
    } catch (...) {
      static_cast<void>(stop());
      throw;
    }
  }

  ~FalconDevice() override { static_cast<void>(stop()); }

  const DeviceIdentity& identity() const noexcept override { return identity_; }

  DeviceReport newest_report() noexcept override {
    static_cast<void>(reports_.fetch(report_for_servo_));
    return report_for_servo_;
  }

  // The exchange never pauses, so nobody needs to be woken.
  void command(const MotorCommand& command) noexcept override {
    commands_.publish({command, rt::Clock::now()});
  }

  DeviceHealth health() const noexcept override {
    DeviceHealth health = health_.load(std::memory_order_acquire);
    // The I/O thread can be held by the kernel, so silence is noticed here, too.
    if (health == DeviceHealth::kRunning && silent(rt::Clock::now())) {
      health_.compare_exchange_strong(health, DeviceHealth::kStale, std::memory_order_acq_rel);
      health = health_.load(std::memory_order_acquire);
    }
    return health;
  }

  DeviceStatistics statistics() const noexcept override {
    const auto value = [](const std::atomic<std::uint64_t>& counter) {
      return counter.load(std::memory_order_relaxed);
    };
    return {.reports_received = value(statistics_.reports_received),
            .reports_rejected = value(statistics_.reports_rejected),
            .reports_drained = value(statistics_.reports_drained),
            .reports_lost = value(statistics_.reports_lost),
            .commands_sent = value(statistics_.commands_sent),
            .kicks = value(statistics_.reports_lost),
            .commands_starved = value(statistics_.commands_starved),
            .commands_not_finite = value(statistics_.commands_not_finite),
            .commands_clamped = value(statistics_.commands_clamped)};
  }

  std::string failure() const override {
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

  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {
    throw DeviceError("device '" + identity_.url +
                      "': its counters can't be set from the host; home it instead: " +
                      parameters_.homing_instruction);
  }

  bool stop() noexcept override {
    const std::lock_guard lock(stop_mutex_);
    if (thread_.joinable()) {
      stop_requested_.store(true, std::memory_order_release);
      thread_.join();
    } else if (!stopped_) {
      finish();
    }
    stopped_ = true;
    return zero_delivered_;
  }

 private:
  bool silent(rt::TimePoint now) const noexcept {
    const rt::TimePoint last{rt::Duration(last_report_.load(std::memory_order_acquire))};
    return now - last > options_.stale_after;
  }

  std::string stale_words() const {
    return "device '" + identity_.url + "': no packet for " +
           std::to_string(std::chrono::duration_cast<milliseconds>(options_.stale_after).count()) +
           " ms; check the cable and the Falcon's power, then open it again";
  }

  void fail(DeviceHealth health, const std::string& words) noexcept {
    {
      const std::lock_guard lock(failure_mutex_);
      if (failure_.empty()) {
        failure_ = words;
      }
    }
    DeviceHealth expected = DeviceHealth::kRunning;
    health_.compare_exchange_strong(expected, health, std::memory_order_acq_rel);
  }

  bool running() const noexcept {
    return health_.load(std::memory_order_acquire) == DeviceHealth::kRunning;
  }

  /// @returns false when the transport has ended.
  bool usable(TransportStatus status) noexcept {
    if (status == TransportStatus::kOk || status == TransportStatus::kTimeout) {
      return true;
    }
    fail(status == TransportStatus::kDisconnected ? DeviceHealth::kUnplugged
                                                  : DeviceHealth::kProtocol,
         transport_->failure());
    return false;
  }

  // --- one exchange ---

  TransportStatus send(const falcon::OutPacket& packet) noexcept {
    const WriteResult result = port_.write(falcon::encode(packet), options_.write_timeout);
    if (result.status == TransportStatus::kOk) {
      count(statistics_.commands_sent);
      ++unanswered_;
      ++owed_;
      released_ = result.completed;
    }
    return result.status;
  }

  /// Waits for the reply to the last packet; after a loss also for the one that may follow it.
  /// @returns kOk with the newest reply in `newest`.
  TransportStatus receive(rt::Duration timeout, falcon::InPacket& newest,
                          rt::TimePoint& arrived) noexcept {
    rt::TimePoint deadline = rt::Clock::now() + timeout;
    bool found = false;
    for (int i = 0; i < kMaxPacketsOfOneReply && (!found || unanswered_ > 0); ++i) {
      const auto read = port_.read(deadline - rt::Clock::now());
      if (read.status == TransportStatus::kTimeout) {
        break;
      }
      if (read.status != TransportStatus::kOk) {
        return read.status;
      }
      const std::uint64_t skipped = parser_.skipped_bytes();
      for (const std::uint8_t byte : read.data) {
        if (parser_.take(byte, newest)) {
          if (found) {
            count(statistics_.reports_drained);
          } else {
            deadline = rt::Clock::now() + kSettleAfterLoss;
          }
          found = true;
          arrived = read.arrived;
          unanswered_ = std::max(0, unanswered_ - 1);
          --owed_;
        }
      }
      if (parser_.skipped_bytes() != skipped) {
        count(statistics_.reports_rejected);
      }
    }
    if (!found) {
      return TransportStatus::kTimeout;
    }
    unanswered_ = 0;
    return TransportStatus::kOk;
  }

  void publish(const falcon::InPacket& packet, rt::TimePoint arrived) noexcept {
    last_report_.store(arrived.time_since_epoch().count(), std::memory_order_release);
    count(statistics_.reports_received);
    if (homed_ != falcon::kAllHomed && packet.homed == falcon::kAllHomed) {
      // What was commanded until now was meant for positions that nobody knew.
      static_cast<void>(commands_.fetch(latest_));
      commanded_ = false;
    }
    homed_ = packet.homed;
    DeviceReport report;
    report.sequence = ++sequence_;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      report.counts[axis] = packet.counts[axis];
    }
    report.homed = packet.homed;
    report.buttons = packet.buttons;
    report.released = released_;
    report.received = arrived;
    reports_.publish(report);
  }

  /// What to send now.
  falcon::OutPacket next_packet() noexcept {
    const bool homed = homed_ == falcon::kAllHomed;
    falcon::OutPacket packet;
    packet.leds = homed ? falcon::kLedGreen : falcon::kLedRed;
    const bool is_new = commands_.fetch(latest_);
    commanded_ = commanded_ || is_new;
    if (!homed || !commanded_) {
      return packet;
    }
    if (rt::Clock::now() >= latest_.issued + options_.servo_silence) {
      count(statistics_.commands_starved);
      return packet;
    }
    const falcon::Commands commands = falcon::commands_for_torque(
        latest_.command.joint_torque_Nm, parameters_.torque_gain_per_Nm, parameters_.command_limit);
    if (is_new && !commands.finite) {
      count(statistics_.commands_not_finite);
    }
    if (is_new && commands.scaled) {
      count(statistics_.commands_clamped);
    }
    // Read last: a fault that another thread has noticed in between must not let a force pass.
    if (running()) {
      packet.command = commands.command;
    }
    return packet;
  }

  /// The first report, which open_device() promises; bring_up() has seen an answer just before.
  void first_exchange() {
    const rt::TimePoint deadline = rt::Clock::now() + options_.open_timeout;
    do {
      falcon::InPacket packet;
      rt::TimePoint arrived;
      TransportStatus status = send({.leds = falcon::kLedRed});
      if (status == TransportStatus::kOk) {
        status = receive(kReplyTimeout, packet, arrived);
      }
      if (status == TransportStatus::kOk) {
        publish(packet, arrived);
        return;
      }
      if (status != TransportStatus::kTimeout) {
        throw DeviceError(transport_->failure());
      }
    } while (rt::Clock::now() < deadline);
    throw DeviceError("device '" + identity_.url +
                      "': its firmware answered once and then no more; switch the Falcon off and "
                      "on again, and try once more");
  }

  // --- the I/O thread ---

  void run() noexcept {
    while (running() && !stop_requested_.load(std::memory_order_acquire)) {
      const rt::TimePoint begun = rt::Clock::now();
      exchange();
      rt::sleep_until(begun + kShortestExchange);
    }
    if (!stop_requested_.load(std::memory_order_acquire)) {
      // A fault: the motors get zero at once, not only when somebody calls stop().
      zero_delivered_ = deliver_zero();
      while (!stop_requested_.load(std::memory_order_acquire)) {
        rt::sleep_until(rt::Clock::now() + kPollWhenFaulted);
      }
    }
    finish();
  }

  void exchange() noexcept {
    if (!usable(send(next_packet()))) {
      return;
    }
    falcon::InPacket packet;
    rt::TimePoint arrived;
    const TransportStatus status = receive(kReplyTimeout, packet, arrived);
    if (!usable(status)) {
      return;
    }
    if (status == TransportStatus::kTimeout) {
      count(statistics_.reports_lost);
      if (silent(rt::Clock::now())) {
        fail(DeviceHealth::kStale, stale_words());
      }
      return;
    }
    if (homed_ == falcon::kAllHomed && packet.homed != falcon::kAllHomed) {
      fail(DeviceHealth::kProtocol,
           "device '" + identity_.url + "': axis " + falcon_axes_not_homed(packet.homed) +
               " lost its reference, so the positions are not known any more (the Falcon may have "
               "been switched off or restarted); start again and home it: " +
               parameters_.homing_instruction);
      return;
    }
    publish(packet, arrived);
  }

  /// @returns true when the firmware has answered a zero command. Replies don't say to what: when
  /// one was ever late, lost or repeated, all that is on its way is let arrive, and the answer to
  /// another zero counts.
  bool deliver_zero() noexcept {
    bool in_step = owed_ == 0;
    for (int attempt = 0; attempt < kLastZeroAttempts; ++attempt) {
      const std::uint8_t leds = homed_ == falcon::kAllHomed ? falcon::kLedGreen : falcon::kLedRed;
      falcon::InPacket packet;
      rt::TimePoint arrived;
      TransportStatus status = send({.leds = leds});
      if (status == TransportStatus::kOk) {
        status = receive(kReplyTimeout, packet, arrived);
      }
      if (status == TransportStatus::kOk && !in_step) {
        in_step = true;
        status = let_arrive();
      }
      if (status != TransportStatus::kTimeout) {
        return status == TransportStatus::kOk;
      }
    }
    return false;
  }

  /// @returns kTimeout once nothing has come for as long as a reply may take.
  TransportStatus let_arrive() noexcept {
    for (int i = 0; i < kMaxPacketsOfOneReply; ++i) {
      const auto read = port_.read(kReplyTimeout);
      if (read.status != TransportStatus::kOk) {
        return read.status;
      }
      falcon::InPacket ignored;
      for (const std::uint8_t byte : read.data) {
        if (parser_.take(byte, ignored)) {
          count(statistics_.reports_drained);
        }
      }
    }
    return TransportStatus::kTimeout;
  }

  /// The last zero, then the end of the transport.
  void finish() noexcept {
    // A boot loader would take the packet for a part of the image.
    zero_delivered_ = exchanging_ && deliver_zero();
    transport_->close();
    DeviceHealth expected = DeviceHealth::kRunning;
    health_.compare_exchange_strong(expected, DeviceHealth::kClosed, std::memory_order_acq_rel);
  }

  std::unique_ptr<BulkTransport> transport_;
  ftdi::FtdiPort port_;
  const profiles::DeviceProfile::Falcon parameters_;
  const OpenOptions options_;
  const DeviceIdentity identity_;

  // I/O thread (and opening thread before it starts).
  falcon::PacketParser parser_;
  IssuedCommand latest_;
  rt::TimePoint released_{};
  std::uint64_t sequence_ = 0;
  int unanswered_ = 0;     ///< packets sent since the last reply
  std::int64_t owed_ = 0;  ///< packets sent less replies, ever
  std::uint8_t homed_ = 0;
  bool commanded_ = false;
  bool exchanging_ = false;      ///< the firmware runs
  bool zero_delivered_ = false;  ///< read after the thread has been joined

  // Set-up and servo thread.
  DeviceReport report_for_servo_;
  bool stopped_ = false;
  std::mutex stop_mutex_;

  // Between threads.
  rt::Mailbox<DeviceReport> reports_;
  rt::Mailbox<IssuedCommand> commands_;
  AtomicStatistics statistics_;
  std::atomic<std::int64_t> last_report_{0};  ///< the clock's ticks
  mutable std::atomic<DeviceHealth> health_{DeviceHealth::kRunning};
  std::atomic<bool> stop_requested_{false};
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::thread thread_;
};

}  // namespace

std::string falcon_axes_not_homed(std::uint8_t homed) {
  constexpr const char* kNames[] = {"1 (top)", "2 (right)", "3 (left)"};
  std::string text;
  for (unsigned axis = 0; axis < 3; ++axis) {
    if ((homed & (1U << axis)) == 0) {
      text += (text.empty() ? "" : ", ") + std::string(kNames[axis]);
    }
  }
  return text;
}

std::unique_ptr<Device> start_falcon_device(std::unique_ptr<BulkTransport> transport,
                                            const profiles::DeviceProfile& profile,
                                            const OpenOptions& options, const std::string& url,
                                            bool check_ids, const falcon::StartupTiming& timing) {
  const TransportIdentity& identity = transport->identity();
  if (check_ids && (identity.vendor_id != profile.usb.vendor_id ||
                    identity.product_id != profile.usb.product_id)) {
    char ids[64];
    std::snprintf(ids, sizeof ids, "it is %04x:%04x where profile '", identity.vendor_id,
                  identity.product_id);
    char wanted[16];
    std::snprintf(wanted, sizeof wanted, "%04x:%04x", profile.usb.vendor_id,
                  profile.usb.product_id);
    throw DeviceError("device '" + url + "': " + ids + profile.name + "' has " + wanted +
                      "; name another device or profile");
  }
  return std::make_unique<FalconDevice>(std::move(transport), profile, options, url, timing);
}

}  // namespace forcegrid::driver
