// SPDX-License-Identifier: Apache-2.0
#include "driver/w2_device.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "driver/counter_loading.h"
#include "driver/io_thread_device.h"
#include "driver/open_outs.h"
#include "driver/w2_codec.h"

namespace forcegrid::driver {
namespace {

// Then a report counts as lost. USB loses none, so this is long enough for a host that is late.
constexpr rt::Duration kReadTimeout = std::chrono::milliseconds(40);
// While another report may still be on its way from before a kick: one round trip each way.
constexpr rt::Duration kSettleAfterKick = std::chrono::milliseconds(3);
constexpr rt::Duration kW2PollWhenFaulted = std::chrono::milliseconds(500);
// A wait for a report looks this often whether it is to be given up for the last zero.
constexpr rt::Duration kLookUp = std::chrono::milliseconds(5);
constexpr rt::Duration kDoubtMargin = std::chrono::milliseconds(5);
constexpr int kZeroAttempts = 2;
constexpr int kMaxDrained = 64;  // hidraw queues as many
constexpr int kMaxRejectedInARow = 10;
constexpr double kRefreshPhase = 0.6;   // of a bus frame after a report
constexpr double kRefreshMargin = 0.1;  // of a bus frame, for the way from here to the servo
constexpr int kRefreshDecay = 16;       // exchanges

constexpr std::size_t kBufferBytes = 65;  // a report that is too long is seen as such

/// Why an exchange is begun.
enum class Reason : std::uint8_t { kNone, kCommand, kRefresh, kCounters, kStop };

class W2Device final : public IoThreadDevice {
 public:
  W2Device(std::unique_ptr<Transport> transport, const profiles::DeviceProfile& profile,
           const OpenOptions& options, const std::string& url)
      : IoThreadDevice(options,
                       {url, transport->identity().manufacturer, transport->identity().product,
                        transport->identity().serial},
                       "no report for",
                       "check the cable and the device's power, then open it again"),
        transport_(std::move(transport)),
        max_current_A_(profile.motors.max_current_A),
        max_wrist_current_A_(profile.gimbal_motors.max_current_A),
        wire_bytes_(static_cast<std::size_t>(profile.usb.report_bytes)),
        has_stylus_button_(profile.gimbal.stylus_button),
        frame_(std::chrono::microseconds(profile.usb.frame_period_us)),
        refresh_time_(frame_),
        may_overlap_(transport_->can_wait()),
        wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    if (wake_ < 0) {
      throw DeviceError("device '" + url + "': eventfd: " + std::strerror(errno) +
                        "; raise the limit of open files");
    }
    try {
      begin_exchange();
      start_thread();
    } catch (...) {
      static_cast<void>(stop());
      ::close(wake_);
      throw;
    }
  }

  ~W2Device() override {
    static_cast<void>(stop());
    ::close(wake_);
  }

  void load_counters(const std::array<std::int16_t, 6>& counts, rt::Duration timeout) override {
    const rt::TimePoint deadline = rt::Clock::now() + timeout;
    const std::uint32_t id = ++last_counter_request_;
    counter_requests_.publish({.id = id, .counts = counts, .deadline = deadline});
    wake_up();
    while (counters_loaded_.load(std::memory_order_acquire) != id) {
      if (health() != DeviceHealth::kRunning) {
        throw DeviceError(failure());
      }
      // The I/O thread gives up at the deadline; a little later it can't succeed any more.
      if (rt::Clock::now() > deadline + kReadTimeout + options_.write_timeout) {
        throw DeviceError("device '" + identity_.url + "': " + why_not_taken(arm_only_));
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

 private:
  void wake_up() const noexcept override {
    const std::uint64_t one = 1;
    // It can only fail when it has been woken 2^64 - 1 times already.
    static_cast<void>(!::write(wake_, &one, sizeof one));
  }

  /// Sleeps until `deadline` or wake_up().
  void wait(rt::TimePoint deadline) const noexcept {
    const auto left = std::max(deadline - rt::Clock::now(), rt::Duration::zero());
    const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
    const timespec time{
        .tv_sec = whole.count(),
        .tv_nsec = static_cast<long>(
            std::chrono::duration_cast<std::chrono::nanoseconds>(left - whole).count())};
    pollfd entry{.fd = wake_, .events = POLLIN, .revents = 0};
    if (::ppoll(&entry, 1, &time, nullptr) > 0) {
      std::uint64_t times = 0;
      static_cast<void>(!::read(wake_, &times, sizeof times));
    }
  }

  // --- one exchange ---

  WriteResult send(const w2::OutBytes& bytes, bool last_zero = false) noexcept {
    std::array<std::uint8_t, w2::kW3ReportBytes> padded{};
    std::copy(bytes.begin(), bytes.end(), padded.begin());
    const rt::TimePoint begun = rt::Clock::now();
    const WriteResult result =
        transport_->write(std::span(padded).first(wire_bytes_), options_.write_timeout);
    if (result.status == TransportStatus::kOk) {
      count(statistics_.commands_sent);
      open_outs_.push({.sent = begun, .completed = result.completed, .last_zero = last_zero});
    }
    return result;
  }

  [[nodiscard]] bool decode(std::size_t bytes, w2::InputReport& input) const noexcept {
    return w2::decode({buffer_.data(), std::min(bytes, buffer_.size())}, input, wire_bytes_,
                      has_stylus_button_);
  }

  /// One report. A wait for it ends early when the last zero is due, which must not wait.
  ReadResult read(rt::Duration timeout) noexcept {
    const rt::TimePoint deadline = rt::Clock::now() + timeout;
    for (;;) {
      const rt::Duration left = std::max(deadline - rt::Clock::now(), rt::Duration::zero());
      const ReadResult result = transport_->read(buffer_, std::min(left, kLookUp));
      if (result.status != TransportStatus::kTimeout || left <= kLookUp ||
          (exchanging_ && (stopping() || !running()))) {
        return result;
      }
    }
  }

  /// @param asked false: the report answers nothing that was sent, although no report is missing.
  void notice(const w2::InputReport& input, bool asked, rt::TimePoint arrived) noexcept {
    if (asked) {
      return foreign_replies_.answered(input);
    }
    count(statistics_.reports_unasked);
    if (foreign_replies_.take(input, arrived) && exchanging_) {
      fail(DeviceHealth::kSecondWriter,
           "device '" + identity_.url +
               "': it answers commands that this program did not send, so another program "
               "commands it; end that program ('forcegrid devices' names it)");
    }
  }

  /// Reads for at most `timeout`, and then what else is queued, so that the newest report is left.
  /// @returns kOk with the newest whole report in `newest`, kTimeout when none came.
  TransportStatus receive(rt::Duration timeout, rt::Duration settle, w2::InputReport& newest,
                          rt::TimePoint& arrived) noexcept {
    int found = 0;
    for (int i = 0; i < kMaxDrained; ++i) {
      const ReadResult result =
          read(i == 0 ? timeout : (found > 0 ? settle : rt::Duration::zero()));
      if (result.status == TransportStatus::kTimeout) {
        break;
      }
      if (result.status != TransportStatus::kOk) {
        return result.status;
      }
      last_length_ = result.bytes;
      const bool asked = open_outs_.answer();
      w2::InputReport input;
      if (!decode(result.bytes, input)) {
        count(statistics_.reports_rejected);
        ++rejected_in_a_row_;
        wrong_length_ = true;
        continue;
      }
      rejected_in_a_row_ = 0;
      if (found > 0) {
        count(statistics_.reports_drained);
      }
      notice(input, asked, result.arrived);
      if (asked || found == 0) {
        newest = input;
        arrived = result.arrived;
        ++found;
      }
    }
    return found > 0 ? TransportStatus::kOk : TransportStatus::kTimeout;
  }

  void publish(const w2::InputReport& input, rt::TimePoint arrived) noexcept {
    // In doubt, any OUT from the oldest to the newest may have released it.
    const Out& oldest = open_outs_.answered();
    const rt::TimePoint released =
        open_outs_.in_doubt() ? open_outs_.newest().completed : oldest.completed;
    prompt_ = arrived - released <= OpenOuts::kPrompt;
    if (!prompt_) {
      count(statistics_.reports_late);
    }
    publish_report({.sequence = ++sequence_,
                    .counts = unwrapper_.follow(input.counts),
                    .calibration_button = input.calibration_button,
                    .buttons = static_cast<std::uint8_t>(input.stylus_button ? 1 : 0),
                    .sampled_after = oldest.sent,
                    .released = released,
                    .oldest_release = oldest.completed,
                    .received = arrived});
    last_arrival_ = arrived;
  }

  // --- opening, on the opening thread ---

  /// Kick start: W2 speaks first, but its first report may have gone to another host, or to nobody
  /// since the kernel discards reports for a while after opening. The first report that comes may
  /// be arbitrarily old and is discarded; a zero write keeps the ping-pong going.
  void begin_exchange() {
    const rt::TimePoint deadline = rt::Clock::now() + options_.open_timeout;
    bool discarded_first = false;
    while (rt::Clock::now() < deadline) {
      w2::InputReport input;
      rt::TimePoint arrived;
      wrong_length_ = false;
      const TransportStatus status =
          receive(kReadTimeout, discarded_first ? rt::Duration::zero() : options_.settle_at_open,
                  input, arrived);
      if (status != TransportStatus::kOk && status != TransportStatus::kTimeout) {
        throw DeviceError(transport_->failure());
      }
      if (wrong_length_) {
        throw DeviceError(wrong_length_words());
      }
      if (status == TransportStatus::kOk && discarded_first &&
          open_outs_.answered().sent != rt::TimePoint{}) {
        publish(input, arrived);
        return;
      }
      if (status == TransportStatus::kOk) {
        discarded_first = true;
        count(statistics_.reports_discarded);
      }
      if (status == TransportStatus::kTimeout) {
        count(statistics_.kicks);
      }
      const WriteResult sent = send({});
      if (sent.status != TransportStatus::kOk && sent.status != TransportStatus::kTimeout) {
        throw DeviceError(transport_->failure());
      }
    }
    throw DeviceError(
        "device '" + identity_.url + "': no report within " +
        std::to_string(
            std::chrono::duration_cast<std::chrono::milliseconds>(options_.open_timeout).count()) +
        " ms; press the device's reset button or plug it in again, and end other programs that use "
        "it");
  }

  std::string wrong_length_words() const {
    return "device '" + identity_.url + "': it sends reports of " + std::to_string(last_length_) +
           " bytes where its profile has " + std::to_string(wire_bytes_) +
           (last_length_ == w2::kW1ReportBytes
                ? "; this is the older W1 firmware, which can't be calibrated from the host and "
                  "counts the other way: install the W2 firmware"
                : "; check that it is the device of the profile");
  }

  // --- the I/O thread ---

  void run() noexcept override {
    exchanging_ = true;
    while (running() && !stopping()) {
      const Reason reason = wait_for_reason();
      if (reason == Reason::kStop || health() != DeviceHealth::kRunning) {
        break;
      }
      exchange(reason);
    }
    if (!stopping()) {
      // A fault: the motors get zero at once, not only when somebody calls stop().
      zero_delivered_ = deliver_zero();
      while (!stopping()) {
        wait(rt::Clock::now() + kW2PollWhenFaulted);
      }
    }
    finish();
  }

  /// Sends zero current until the device has acted on it. That it took the report is no proof: a
  /// firmware that waits for the host to collect a report takes the next one into its queue and
  /// looks at it later, or never. The report that the zero releases is, and that comes after those
  /// that are still on their way.
  bool deliver_zero() noexcept {
    exchanging_ = false;
    for (int attempt = 0; attempt < kZeroAttempts; ++attempt) {
      w2::InputReport input;
      rt::TimePoint arrived;
      if (receive(rt::Duration::zero(), rt::Duration::zero(), input, arrived) ==
          TransportStatus::kOk) {
        count(statistics_.reports_discarded);
      }
      if (send({}, true).status != TransportStatus::kOk) {
        return false;
      }
      const rt::TimePoint deadline = rt::Clock::now() + kReadTimeout;
      for (rt::TimePoint now = rt::Clock::now(); now < deadline; now = rt::Clock::now()) {
        const TransportStatus status =
            receive(deadline - now, rt::Duration::zero(), input, arrived);
        if (status == TransportStatus::kOk) {
          count(statistics_.reports_discarded);
        } else if (status != TransportStatus::kTimeout) {
          return false;
        }
        if (open_outs_.answered().last_zero) {
          return true;
        }
      }
    }
    return false;
  }

  /// The last zero, then the end of the transport.
  void finish() noexcept override {
    // Since a delivered zero after a fault no current has been sent.
    zero_delivered_ = zero_delivered_ || deliver_zero();
    transport_->close();
    closed();
  }

  /// When the next refresh may begin.
  struct RefreshPlan {
    bool permitted = false;
    rt::TimePoint at{};  ///< when it is due; if not permitted: when to look again
  };

  /// The device samples its counters when it takes an OUT, so the counts that the servo will read
  /// are as old as the last OUT. A new command is sent at once. Without one, the last command is
  /// sent again after 0.6 of a bus frame, in time for the next frame, so that the counts stay
  /// fresh; but not when that could still be in the way at the servo's next read, for then the
  /// command that follows that read would have to wait for it.
  RefreshPlan plan_refresh(rt::TimePoint now) noexcept {
    const rt::TimePoint due =
        (may_overlap_ ? open_outs_.newest().completed : last_arrival_) + scaled(kRefreshPhase);
    const rt::TimePoint silent_at = latest_.issued + options_.servo_silence;
    const rt::TimePoint next_read = latest_.command.next_read;
    if (!commanded_ || now >= silent_at || next_read == rt::TimePoint{} ||
        std::max(now, due) + refresh_time_ + scaled(kRefreshMargin) <= next_read) {
      return {.permitted = true, .at = due};
    }
    if (!held_back_) {
      held_back_ = true;
      // Else one slow refresh would hold back for ever the ones that could correct it.
      refresh_time_ -= refresh_time_ / kRefreshDecay;
    }
    return {.permitted = false, .at = std::max(silent_at, due)};
  }

  /// After the last report has come: waits for the moment of the next exchange, and says why.
  Reason wait_for_reason() noexcept {
    for (;;) {
      if (stopping()) {
        return Reason::kStop;
      }
      if (take_counter_request()) {
        return Reason::kCounters;
      }
      if (take_command()) {
        return Reason::kCommand;
      }
      const rt::TimePoint now = rt::Clock::now();
      const RefreshPlan refresh = plan_refresh(now);
      if (refresh.permitted && now >= refresh.at) {
        return Reason::kRefresh;
      }
      wait(refresh.at);
    }
  }

  bool take_counter_request() noexcept {
    counters_pending_ = counter_requests_.fetch(counter_request_) || counters_pending_;
    return counters_pending_;
  }

  bool take_command() noexcept {
    const bool taken = commands_.fetch(latest_);
    commanded_ = commanded_ || taken;
    return taken;
  }

  rt::Duration scaled(double frames) const noexcept {
    return std::chrono::duration_cast<rt::Duration>(frames * frame_);
  }

  w2::OutBytes bytes_for(Reason reason) noexcept {
    if (reason == Reason::kCounters) {
      commanded_ = false;
      unwrapper_.restart(counter_request_.counts);
      return w2::out_bytes(w2::encode_load_counters(counter_request_.counts));
    }
    if (!commanded_) {
      return {};
    }
    if (rt::Clock::now() >= latest_.issued + options_.servo_silence) {
      count(statistics_.commands_starved);
      return {};
    }
    const auto& [current_A, torque_Nm, wrist_A, next_read] = latest_.command;
    const w2::Currents arm = w2::report_currents(current_A, max_current_A_);
    const w2::Currents wrist = w2::report_currents(wrist_A, max_wrist_current_A_);
    const bool finite = arm.finite && wrist.finite;
    if (reason == Reason::kCommand && !finite) {
      count(statistics_.commands_not_finite);
    }
    if (reason == Reason::kCommand && (arm.clamped || wrist.clamped)) {
      count(statistics_.commands_clamped);
    }
    // Read last: a fault that another thread has noticed in between must not let a current pass.
    return finite && running()
               ? w2::out_bytes(w2::encode_currents(arm.current_mA), wrist.current_mA)
               : w2::OutBytes{};
  }

  WriteResult send_for(Reason reason) noexcept {
    held_back_ = false;
    const w2::OutBytes bytes = bytes_for(reason);
    const rt::TimePoint begun = rt::Clock::now();
    const WriteResult sent = send(bytes);
    if (reason == Reason::kRefresh) {
      count(statistics_.refreshes);
      if (may_overlap_ && sent.status == TransportStatus::kOk) {
        learn_refresh_time(sent.completed - begun);
      }
    }
    return sent;
  }

  /// Sends, and waits for the report that this releases. What else is to be sent meanwhile goes out
  /// without waiting, if the transport allows: on a bus that serves IN before OUT, a report comes a
  /// frame later than the OUT that released it, and waiting for it would halve the rate and age the
  /// counts by a frame. Where reports come later than that, it would only age them: slow firmware
  /// takes the second OUT before it gives the report of the first. There are never more than two
  /// OUTs without their reports, and reports come in the order of their OUTs.
  void exchange(Reason reason) noexcept {
    if (!discard_unasked()) {
      return;
    }
    const rt::TimePoint begun = rt::Clock::now();
    WriteResult sent = send_for(reason);
    rt::Duration settle = rt::Duration::zero();
    bool was_overlapped = false;
    bool kicked = false;
    for (;;) {
      if (!usable(sent.status)) {
        fail_with(sent.status, transport_->failure());
        return;
      }
      bool overlapping = false;
      WriteResult second;
      Reason next = Reason::kNone;
      if (may_overlap_ && prompt_ && !open_outs_.in_doubt() && !kicked &&
          reason != Reason::kCounters && sent.status == TransportStatus::kOk) {
        next = wait_for_report_or_reason();
      }
      if (next != Reason::kNone) {
        was_overlapped = true;
        second = send_for(next);
        if (!usable(second.status)) {
          fail_with(second.status, transport_->failure());
          return;
        }
        overlapping = second.status == TransportStatus::kOk;
      }
      w2::InputReport input;
      rt::TimePoint arrived;
      wrong_length_ = false;
      const TransportStatus status = receive(kReadTimeout, settle, input, arrived);
      if (status == TransportStatus::kOk) {
        publish(input, arrived);
        if (reason == Reason::kRefresh && !kicked && !may_overlap_) {
          learn_refresh_time(arrived - begun);
        }
        if (reason == Reason::kCounters) {
          check_counters(input);
        }
        if (open_outs_.in_doubt()) {
          settle_doubt(arrived);
          return;
        }
        if (!overlapping || open_outs_.empty()) {
          return;
        }
        sent = second;
        reason = next;
        continue;
      }
      if (status != TransportStatus::kTimeout) {
        fail_with(status, transport_->failure());
        return;
      }
      if (rejected_in_a_row_ >= kMaxRejectedInARow) {
        fail(DeviceHealth::kProtocol, wrong_length_words());
        return;
      }
      if (stopping()) {
        return;
      }
      if (silent(rt::Clock::now())) {
        fail(DeviceHealth::kStale, stale_words());
        return;
      }
      // No usable report: a discarded one must be followed by a write, and a lost one by a kick, or
      // the ping-pong stands still.
      if (!wrong_length_) {
        count(statistics_.reports_lost);
        count(statistics_.kicks);
        settle = kSettleAfterKick;
        // A device may answer two OUTs with one report. It does so once, then each waits for its
        // own.
        may_overlap_ = may_overlap_ && !was_overlapped;
        open_outs_.doubt();
      }
      kicked = true;
      sent = send({});
    }
  }

  /// After a kick, the report before it may be lost or on its way, and a late one would pass for
  /// the answer to a later OUT, and its counts for younger than they are. Where a report's time
  /// does not tell, nothing is sent until another would have come, as late as this one.
  void settle_doubt(rt::TimePoint arrived) noexcept {
    const std::size_t given_up = open_outs_.given_up();
    if (!open_outs_.judge(arrived)) {
      wait_for_late_reports(arrived);
    }
    foreign_replies_.expect(open_outs_.given_up() - given_up, rt::Clock::now());
  }

  void wait_for_late_reports(rt::TimePoint arrived) noexcept {
    const rt::Duration late_by = std::clamp(arrived - open_outs_.answered().completed,
                                            rt::Duration::zero(), options_.stale_after);
    const rt::TimePoint deadline = open_outs_.newest().completed + late_by + kDoubtMargin;
    for (rt::TimePoint now = arrived;
         !open_outs_.empty() && now < deadline && running() && !stopping();
         now = rt::Clock::now()) {
      w2::InputReport input;
      const TransportStatus status = receive(deadline - now, rt::Duration::zero(), input, arrived);
      if (status == TransportStatus::kOk) {
        if (open_outs_.empty()) {
          open_outs_.give_up();
        }
        publish(input, arrived);
      } else if (status != TransportStatus::kTimeout) {
        fail_with(status, transport_->failure());
      } else if (silent(rt::Clock::now())) {
        fail(DeviceHealth::kStale, stale_words());
      }
    }
    open_outs_.give_up();
  }

  /// What has come before the next OUT is a duplicate, or a report that is late: taken for the
  /// answer to the next OUT, it would shift all answers after it.
  /// @returns false after a failure.
  bool discard_unasked() noexcept {
    for (int i = 0; i < kMaxDrained; ++i) {
      const ReadResult result = transport_->read(buffer_, rt::Duration::zero());
      if (result.status == TransportStatus::kTimeout) {
        return true;
      }
      if (result.status != TransportStatus::kOk) {
        fail_with(result.status, transport_->failure());
        return false;
      }
      count(statistics_.reports_drained);
      w2::InputReport input;
      const bool whole = decode(result.bytes, input);
      const bool asked = open_outs_.answer();
      if (asked || !whole) {
        count(statistics_.reports_unasked);
      }
      if (whole) {
        notice(input, asked, result.arrived);
      }
    }
    return running();
  }

  /// While a report is on its way: waits for it, or for a reason to send something before it.
  /// @returns kCommand or kRefresh; kNone when the report is there, or must be waited for first.
  Reason wait_for_report_or_reason() noexcept {
    const rt::TimePoint deadline = rt::Clock::now() + kReadTimeout;
    for (;;) {
      if (!running() || stopping() || take_counter_request()) {
        return Reason::kNone;
      }
      // What has come already is newer than what a refresh could bring.
      if (transport_->wait(-1, rt::Duration::zero()) == WaitEnd::kReport) {
        return Reason::kNone;
      }
      if (take_command()) {
        return Reason::kCommand;
      }
      const rt::TimePoint now = rt::Clock::now();
      const RefreshPlan refresh = plan_refresh(now);
      if (refresh.permitted && now >= refresh.at) {
        return Reason::kRefresh;
      }
      if (now >= deadline) {
        return Reason::kNone;
      }
      if (transport_->wait(wake_, std::min(refresh.at, deadline) - now) == WaitEnd::kOther) {
        std::uint64_t times = 0;
        static_cast<void>(!::read(wake_, &times, sizeof times));
      }
    }
  }

  void learn_refresh_time(rt::Duration measured) noexcept {
    const rt::Duration bounded = std::min(measured, 2 * frame_);
    refresh_time_ = std::max(bounded, refresh_time_ - (refresh_time_ - bounded) / kRefreshDecay);
  }

  void check_counters(const w2::InputReport& input) noexcept {
    const CountersTaken taken = counters_taken(counter_request_, input);
    arm_only_ = taken == CountersTaken::kArmOnly;
    if (taken == CountersTaken::kAll) {
      counters_pending_ = false;
      counters_loaded_.store(counter_request_.id, std::memory_order_release);
    } else if (rt::Clock::now() > counter_request_.deadline) {
      counters_pending_ = false;
    }
  }

  std::unique_ptr<Transport> transport_;
  const std::array<double, 3> max_current_A_;
  const std::array<double, 3> max_wrist_current_A_;  ///< zero without motors there
  const std::size_t wire_bytes_;                     ///< length of a report: 14 (W2) or 64 (W3)
  const bool has_stylus_button_;                     ///< counter d carries it
  const rt::Duration frame_;

  // I/O thread (and opening thread before it starts).
  /// How long a refresh keeps a command waiting: from its submission until its OUT is taken, or
  /// without overlap until its report comes. Decaying maximum.
  rt::Duration refresh_time_;
  bool may_overlap_;        ///< something may be sent before the report of the last OUT has come
  bool held_back_ = false;  ///< a refresh has been held back since the last OUT
  bool prompt_ = true;      ///< the last report came soon after its OUT
  OpenOuts open_outs_;
  bool exchanging_ = false;  ///< the exchange has begun, and no last zero is due
  ForeignReplies foreign_replies_;
  std::array<std::uint8_t, kBufferBytes> buffer_{};
  w2::CounterUnwrapper unwrapper_;
  IssuedCommand latest_;
  CounterRequest counter_request_;
  rt::TimePoint last_arrival_{};
  std::uint64_t sequence_ = 0;
  std::size_t last_length_ = 0;
  int rejected_in_a_row_ = 0;
  bool wrong_length_ = false;
  bool commanded_ = false;
  bool counters_pending_ = false;

  // Set-up.
  std::uint32_t last_counter_request_ = 0;

  // Between threads.
  rt::Mailbox<CounterRequest> counter_requests_;
  std::atomic<std::uint32_t> counters_loaded_{0};
  std::atomic<bool> arm_only_{false};  ///< the newest report of a request had taken a, b, c alone
  const int wake_;
};

}  // namespace

std::unique_ptr<Device> start_w2_device(std::unique_ptr<Transport> transport,
                                        const profiles::DeviceProfile& profile,
                                        const OpenOptions& options, const std::string& url,
                                        bool ids_must_match) {
  if (ids_must_match) {
    check_ids(transport->identity(), profile, url);
  }
  const std::string objection = descriptor_objection(transport->report_descriptor(), profile);
  if (!objection.empty()) {
    throw DeviceError("device '" + url + "': " + objection);
  }
  return std::make_unique<W2Device>(std::move(transport), profile, options, url);
}

}  // namespace forcegrid::driver
