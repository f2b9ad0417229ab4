// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/w2_firmware.h"

#include <algorithm>

namespace forcegrid::emulator {

namespace {

std::int16_t read_int16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8)));
}

constexpr std::int16_t kLoadCounters = 1;
constexpr std::size_t kStylusCounter = 3;  // d
constexpr std::size_t kSixMotorBytes = 20;

}  // namespace

W2Firmware::W2Firmware(double full_scale_current_A, std::size_t wire_bytes,
                       bool six_motors) noexcept
    : full_scale_current_A_(full_scale_current_A),
      wire_bytes_(std::clamp(wire_bytes, kReportBytes, kPacketBytes)),
      six_motors_(six_motors && wire_bytes_ >= kSixMotorBytes) {}

void W2Firmware::turn_encoders(const std::array<std::int64_t, 6>& position_counts) noexcept {
  if (encoders_) {
    for (std::size_t i = 0; i < 6; ++i) {
      const auto moved = static_cast<std::uint32_t>(position_counts[i] - (*encoders_)[i]);
      counters_[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(counters_[i]) + moved);
    }
  }
  encoders_ = position_counts;
}

void W2Firmware::set_configured(bool configured, rt::TimePoint now) noexcept {
  if (configured && state_ == State::kAwaitConfiguration) {
    started_ = now;
    state_ = State::kStartingUp;
  }
  if (!configured && configured_) {
    in_armed_ = false;
    out_count_ = 0;
    // The blocked send or read returns without a result and the loop continues.
    if (state_ == State::kAwaitCollection || state_ == State::kAwaitReport) {
      state_ = State::kArmReport;
    }
  }
  configured_ = configured;
}

void W2Firmware::reboot() noexcept {
  state_ = State::kAwaitConfiguration;
  configured_ = false;
  counters_ = {};
  info_ = false;
  in_armed_ = false;
  out_count_ = 0;
  watchdog_running_ = false;
  last_feed_.reset();
  outputs_ = Outputs{};
}

bool W2Firmware::offer_out(std::span<const std::uint8_t> packet) noexcept {
  if (!configured_ || out_count_ == kOutDepth || packet.size() > kPacketBytes) {
    return false;
  }
  Packet& slot = out_queue_[out_count_++];
  std::copy(packet.begin(), packet.end(), slot.bytes.begin());
  slot.size = packet.size();
  if (packet.size() == wire_bytes_) {
    ++statistics_.reports_received;
  } else if (packet.size() < wire_bytes_) {
    ++statistics_.short_reports;
  } else {
    ++statistics_.long_reports;
  }
  return true;
}

std::optional<W2Firmware::Report> W2Firmware::collect_in() noexcept {
  if (!in_armed_) {
    return std::nullopt;
  }
  in_armed_ = false;
  ++statistics_.reports_sent;
  return in_report_;
}

bool W2Firmware::run(rt::TimePoint now) noexcept {
  for (;;) {
    switch (state_) {
      case State::kAwaitConfiguration:
        return false;
      case State::kStartingUp:
        if (now - started_ < kStartUp) {
          return false;
        }
        state_ = State::kArmReport;
        break;
      case State::kArmReport:
        if (!configured_) {
          return false;
        }
        in_report_ = sample();
        in_armed_ = true;
        state_ = State::kAwaitCollection;
        return true;
      case State::kAwaitCollection:
        if (in_armed_) {
          return false;
        }
        state_ = State::kAwaitReport;
        break;
      case State::kAwaitReport:
        if (out_count_ == 0) {
          return false;
        }
        statistics_.reports_drained += out_count_ - 1;
        act_on(out_queue_[out_count_ - 1], now);
        out_count_ = 0;
        state_ = State::kArmReport;
        break;
    }
  }
}

std::optional<rt::TimePoint> W2Firmware::watchdog_deadline() const noexcept {
  if (!watchdog_running_) {
    return std::nullopt;
  }
  return *last_feed_ + kWatchdog;
}

bool W2Firmware::check_watchdog(rt::TimePoint now) noexcept {
  if (!watchdog_running_ || now - *last_feed_ < kWatchdog) {
    return false;
  }
  watchdog_running_ = false;
  outputs_ = Outputs{};
  ++statistics_.watchdog_trips;
  return true;
}

W2Firmware::Report W2Firmware::sample() const noexcept {
  Report report;
  report.size_ = wire_bytes_;
  for (std::size_t i = 0; i < 6; ++i) {
    auto low = static_cast<std::uint16_t>(static_cast<std::uint32_t>(counters_[i]) & 0xFFFFU);
    if (i == kStylusCounter && stylus_down_) {
      low = static_cast<std::uint16_t>(low + kStylusOffset);
    }
    report.bytes_[2 * i] = static_cast<std::uint8_t>(low & 0xFFU);
    report.bytes_[2 * i + 1] = static_cast<std::uint8_t>(low >> 8);
  }
  report.bytes_[12] = info_ ? 1 : 0;
  return report;
}

void W2Firmware::act_on(const Packet& packet, rt::TimePoint now) noexcept {
  if (packet.size != wire_bytes_) {
    return;
  }
  last_feed_ = now;
  watchdog_running_ = true;
  ++statistics_.reports_applied;
  outputs_.motor_enable = true;
  const std::uint8_t* bytes = packet.bytes.data();
  if (read_int16(bytes + 6) == kLoadCounters) {
    for (std::size_t i = 0; i < 3; ++i) {
      counters_[i] = read_int16(bytes + 8 + 2 * i);
      counters_[i + 3] = read_int16(bytes + 2 * i);
    }
    info_ = false;
    outputs_.duty.fill(kZeroCurrentDuty);
    ++statistics_.counters_loaded;
    return;
  }
  if (handed_over_) {
    return;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    drive(i, read_int16(bytes + 2 * i));
    if (six_motors_) {
      drive(i + 3, read_int16(bytes + kReportBytes + 2 * i));
    }
  }
}

void W2Firmware::apply(const std::array<std::int16_t, 3>& current_mA) noexcept {
  for (std::size_t i = 0; i < current_mA.size() && handed_over_ && watchdog_running_; ++i) {
    drive(i, current_mA[i]);
  }
}

// Not clamped, as in the device: beyond I_full the duty leaves the amplifier's range.
void W2Firmware::drive(std::size_t motor, std::int16_t current_mA) noexcept {
  const double current_A = 1e-3 * current_mA;
  outputs_.duty[motor] = kZeroCurrentDuty + 0.4 * current_A / full_scale_current_A_;
}

}  // namespace forcegrid::emulator
