// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_device.h"

#include <algorithm>

#include "driver/falcon_codec.h"
#include "driver/ftdi_port.h"
#include "driver/io_thread_device.h"

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
constexpr rt::Duration kFalconPollWhenFaulted = milliseconds(20);
constexpr int kLastZeroAttempts = 3;
constexpr int kMaxPacketsOfOneReply = 64;

/// The exchange never pauses, so no thread has to be woken.
class FalconDevice final : public IoThreadDevice {
 public:
  FalconDevice(std::unique_ptr<BulkTransport> transport, const profiles::DeviceProfile& profile,
               const OpenOptions& options, const std::string& url,
               const falcon::StartupTiming& timing)
      : IoThreadDevice(options,
                       {url, transport->identity().manufacturer, transport->identity().product,
                        transport->identity().serial},
                       "no packet for",
                       "check the cable and the Falcon's power, then open it again"),
        transport_(std::move(transport)),
        port_(*transport_, options.connect_timeout),
        parameters_(profile.falcon) {
    try {
      static_cast<void>(falcon::bring_up(
          port_, [this] { return transport_->failure(); }, url, options_.firmware, options_.notice,
          timing));
      exchanging_ = true;
      first_exchange();
      start_thread();
    } catch (...) {
      static_cast<void>(stop());
      throw;
    }
  }

  ~FalconDevice() override { static_cast<void>(stop()); }

  void load_counters(const std::array<std::int16_t, 6>&, rt::Duration) override {
    throw DeviceError("device '" + identity_.url +
                      "': its counters can't be set from the host; home it instead: " +
                      parameters_.homing_instruction);
  }

 private:
  /// @returns false when the transport has ended.
  bool check(TransportStatus status) noexcept {
    if (!usable(status)) {
      fail_with(status, transport_->failure());
    }
    return usable(status);
  }

  // --- one exchange ---

  TransportStatus send(const falcon::OutPacket& packet) noexcept {
    const rt::TimePoint begun = rt::Clock::now();
    const WriteResult result = port_.write(falcon::encode(packet), options_.write_timeout);
    if (result.status == TransportStatus::kOk) {
      count(statistics_.commands_sent);
      ++unanswered_;
      ++owed_;
      if (unanswered_ == 1) {
        sent_ = begun;
      }
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
    if (homed_ != falcon::kAllHomed && packet.homed == falcon::kAllHomed) {
      // Commands until now were computed from unknown positions.
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
    report.sampled_after = sent_;
    report.released = report.oldest_release = released_;
    report.received = arrived;
    publish_report(report);
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

  void run() noexcept override {
    while (running() && !stopping()) {
      const rt::TimePoint begun = rt::Clock::now();
      exchange();
      rt::sleep_until(begun + kShortestExchange);
    }
    if (!stopping()) {
      // A fault: the motors get zero at once, not only when somebody calls stop().
      zero_delivered_ = deliver_zero();
      while (!stopping()) {
        rt::sleep_until(rt::Clock::now() + kFalconPollWhenFaulted);
      }
    }
    finish();
  }

  void exchange() noexcept {
    if (!check(send(next_packet()))) {
      return;
    }
    falcon::InPacket packet;
    rt::TimePoint arrived;
    const TransportStatus status = receive(kReplyTimeout, packet, arrived);
    if (!check(status)) {
      return;
    }
    if (status == TransportStatus::kTimeout) {
      count(statistics_.reports_lost);
      count(statistics_.kicks);  // the next packet
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
  void finish() noexcept override {
    // A boot loader would take the packet for a part of the image.
    zero_delivered_ = exchanging_ && deliver_zero();
    transport_->close();
    closed();
  }

  std::unique_ptr<BulkTransport> transport_;
  ftdi::FtdiPort port_;
  const profiles::DeviceProfile::Falcon parameters_;

  // I/O thread (and opening thread before it starts).
  falcon::PacketParser parser_;
  IssuedCommand latest_;
  rt::TimePoint sent_{};  ///< when the oldest packet that the next reply can answer was handed over
  rt::TimePoint released_{};
  std::uint64_t sequence_ = 0;
  int unanswered_ = 0;     ///< packets sent since the last reply
  std::int64_t owed_ = 0;  ///< packets sent less replies, ever
  std::uint8_t homed_ = 0;
  bool commanded_ = false;
  bool exchanging_ = false;  ///< the firmware runs
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
                                            bool ids_must_match,
                                            const falcon::StartupTiming& timing) {
  if (ids_must_match) {
    check_ids(transport->identity(), profile, url);
  }
  return std::make_unique<FalconDevice>(std::move(transport), profile, options, url, timing);
}

}  // namespace forcegrid::driver
