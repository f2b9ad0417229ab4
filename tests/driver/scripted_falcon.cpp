// SPDX-License-Identifier: Apache-2.0
#include "scripted_falcon.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <thread>

namespace forcegrid::driver {
namespace {

constexpr std::size_t kPacketData = 62;

bool near(double baud, double nominal) { return std::abs(baud / nominal - 1.0) < 0.03; }

}  // namespace

ScriptedFalcon::ScriptedFalcon(Script script) : script_(std::move(script)), state_(script_.state) {}

// Only the divisors of the sheet's table occur, so half steps are all the fractions there are.
double ScriptedFalcon::baud() const {
  const double divisor = (divisor_value_ & 0x3FFF) + ((divisor_value_ & 0x4000) != 0 ? 0.5 : 0.0);
  return divisor > 0.0 ? 3e6 / divisor : 3e6;
}

bool ScriptedFalcon::control(const ControlRequest& request) {
  if (!plugged_) {
    return false;
  }
  const std::lock_guard lock(mutex_);
  if (!script_.takes_requests) {
    return false;
  }
  requests_.push_back(request);
  if (request.request == 0x00) {
    answer_.clear();
  } else if (request.request == 0x03) {
    divisor_value_ = request.value;
  } else if (request.request == 0x01 && (request.value & 0x0100) != 0) {
    const bool dtr = (request.value & 0x01) != 0;
    if (dtr && !dtr_ && near(baud(), 9600.0)) {
      state_ = State::kCold;
      heard_.clear();
      image_.clear();
    }
    dtr_ = dtr;
  }
  return true;
}

bool ScriptedFalcon::out(std::span<const std::uint8_t> bytes) {
  const std::lock_guard lock(mutex_);
  for (const std::uint8_t byte : bytes) {
    if (!plugged_) {
      return false;
    }
    take(byte);
  }
  return plugged_;
}

std::vector<std::uint8_t> ScriptedFalcon::in() {
  const std::lock_guard lock(mutex_);
  std::vector<std::uint8_t> packet = {0x01, 0x60};
  for (std::size_t i = 0; i < kPacketData && !answer_.empty(); ++i) {
    packet.push_back(answer_.front());
    answer_.pop_front();
  }
  return packet;
}

void ScriptedFalcon::take(std::uint8_t byte) {
  switch (state_) {
    case State::kCold: {
      heard_.push_back(byte);
      if (heard_.size() > 3) {
        heard_.pop_front();
      }
      const std::deque<std::uint8_t> greeting = {0x0A, 0x43, 0x0D};
      if (heard_ == greeting && near(baud(), 9600.0) && script_.answers_greeting) {
        answer_.insert(answer_.end(), script_.before_greeting.begin(),
                       script_.before_greeting.end());
        answer_.insert(answer_.end(), {0x0A, 0x44, 0x2C, 0x0D});
        state_ = State::kAutobaud;
      }
      break;
    }
    case State::kAutobaud:
      if (byte == 0x41 && near(baud(), 142857.0) && !dtr_ && script_.answers_autobaud) {
        answer_.push_back(byte);
        image_.clear();
        state_ = State::kLoading;
      }
      break;
    case State::kLoading:
      take_image_byte(byte);
      break;
    case State::kRunning:
      if (near(baud(), 1.5e6)) {
        take_packet_byte(byte);
      }
      break;
  }
}

void ScriptedFalcon::take_image_byte(std::uint8_t byte) {
  const std::size_t at = image_.size();
  image_.push_back(byte);
  if (script_.unplugged_at == at) {
    plugged_ = false;
    return;
  }
  if (!script_.silent_from || at < *script_.silent_from) {
    answer_.push_back(script_.wrong_echo_at == at ? static_cast<std::uint8_t>(byte ^ 0x10) : byte);
  }
  if (image_is_complete() && script_.runs_what_it_loaded) {
    state_ = State::kRunning;
    packet_.clear();
  }
}

bool ScriptedFalcon::image_is_complete() const {
  const auto word = [&](std::size_t at) {
    return at + 2 <= image_.size() ? image_[at] | (image_[at + 1] << 8) : -1;
  };
  if (word(0) != 0x08AA) {
    return false;
  }
  for (std::size_t at = 22;;) {
    const int words = word(at);
    if (words <= 0) {
      return words == 0;
    }
    at += 6 + 2 * static_cast<std::size_t>(words);
  }
}

void ScriptedFalcon::take_packet_byte(std::uint8_t byte) {
  if (packet_.empty() && byte != '<') {
    return;
  }
  packet_.push_back(byte);
  if (packet_.size() < 16) {
    return;
  }
  std::array<std::uint8_t, 16> packet;
  std::copy(packet_.begin(), packet_.end(), packet.begin());
  packet_.clear();
  if (packet.back() != '>') {
    return;
  }
  if (deaf_) {
    answer_.insert(answer_.end(), owed_.begin(), owed_.end());
    owed_.clear();
    return;
  }
  packets_.push_back(packet);
  for (std::size_t motor = 0; motor < 3; ++motor) {
    unsigned value = 0;
    for (std::size_t digit = 0; digit < 4; ++digit) {
      value |= static_cast<unsigned>(packet[1 + 4 * motor + digit] - 0x41) << (4 * digit);
    }
    largest_command_ = std::max(
        largest_command_, std::abs(static_cast<std::int16_t>(static_cast<std::uint16_t>(value))));
  }
  if (!answering_) {
    return;
  }
  if (swallow_ > 0) {
    --swallow_;
    return;
  }
  const int times = repeat_ > 0 ? 2 : 1;
  repeat_ = std::max(0, repeat_ - 1);
  for (int i = 0; i < times; ++i) {
    std::vector<std::uint8_t> answer = reply();
    if (behind_) {
      std::swap(answer, owed_);
    }
    answer_.insert(answer_.end(), answer.begin(), answer.end());
  }
}

std::vector<std::uint8_t> ScriptedFalcon::reply() const {
  std::vector<std::uint8_t> bytes = script_.before_packet;
  bytes.push_back('<');
  for (const std::int16_t count : counts_) {
    for (int digit = 0; digit < 4; ++digit) {
      bytes.push_back(static_cast<std::uint8_t>(
          0x41 + ((static_cast<std::uint16_t>(count) >> (4 * digit)) & 0xF)));
    }
  }
  bytes.push_back(static_cast<std::uint8_t>(0x41 + ((homed_ << 4) | buttons_)));
  bytes.push_back(0x41);
  bytes.push_back('>');
  return bytes;
}

void ScriptedFalcon::set_counts(const std::array<std::int16_t, 3>& counts) {
  const std::lock_guard lock(mutex_);
  counts_ = counts;
}
void ScriptedFalcon::set_homed(std::uint8_t bits) {
  const std::lock_guard lock(mutex_);
  homed_ = bits;
}
void ScriptedFalcon::set_buttons(std::uint8_t bits) {
  const std::lock_guard lock(mutex_);
  buttons_ = bits;
}
void ScriptedFalcon::set_answering(bool answering) {
  const std::lock_guard lock(mutex_);
  answering_ = answering;
}
void ScriptedFalcon::swallow(int packets) {
  const std::lock_guard lock(mutex_);
  swallow_ = packets;
}
void ScriptedFalcon::repeat(int packets) {
  const std::lock_guard lock(mutex_);
  repeat_ = packets;
}
void ScriptedFalcon::fall_behind() {
  const std::lock_guard lock(mutex_);
  behind_ = true;
}
void ScriptedFalcon::set_deaf(bool deaf) {
  const std::lock_guard lock(mutex_);
  deaf_ = deaf;
}
ScriptedFalcon::State ScriptedFalcon::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}
std::vector<ControlRequest> ScriptedFalcon::requests() const {
  const std::lock_guard lock(mutex_);
  return requests_;
}
std::vector<std::uint8_t> ScriptedFalcon::image() const {
  const std::lock_guard lock(mutex_);
  return image_;
}
std::vector<std::array<std::uint8_t, 16>> ScriptedFalcon::packets() const {
  const std::lock_guard lock(mutex_);
  return packets_;
}
std::array<int, 3> ScriptedFalcon::last_command() const {
  const std::lock_guard lock(mutex_);
  std::array<int, 3> command{};
  if (packets_.empty()) {
    return command;
  }
  for (std::size_t motor = 0; motor < 3; ++motor) {
    int value = 0;
    for (std::size_t digit = 4; digit-- > 0;) {
      value = 16 * value + (packets_.back()[1 + 4 * motor + digit] - 0x41);
    }
    command[motor] = value < 0x8000 ? value : value - 0x10000;
  }
  return command;
}
int ScriptedFalcon::last_flags() const {
  const std::lock_guard lock(mutex_);
  return packets_.empty() ? 0 : packets_.back()[13] - 0x41;
}
int ScriptedFalcon::largest_command() const {
  const std::lock_guard lock(mutex_);
  return largest_command_;
}

TransportStatus ScriptedBulkTransport::gone() noexcept {
  failure_ = closed_ ? "device 'scripted': closed; open it again"
                     : "device 'scripted': unplugged; plug it in again";
  return TransportStatus::kDisconnected;
}

ReadResult ScriptedBulkTransport::read(std::span<std::uint8_t> buffer,
                                       rt::Duration timeout) noexcept {
  if (!falcon_->plugged() || closed_) {
    return {.status = gone()};
  }
  if (timeout <= rt::Duration::zero()) {
    return {.status = TransportStatus::kTimeout};
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(1));
  const std::vector<std::uint8_t> packet = falcon_->in();
  std::copy_n(packet.begin(), std::min(packet.size(), buffer.size()), buffer.begin());
  return {.status = TransportStatus::kOk, .bytes = packet.size(), .arrived = rt::Clock::now()};
}

WriteResult ScriptedBulkTransport::write(std::span<const std::uint8_t> bytes,
                                         rt::Duration) noexcept {
  if (closed_ || !falcon_->out(bytes)) {
    return {.status = gone()};
  }
  return {.status = TransportStatus::kOk, .completed = rt::Clock::now()};
}

TransportStatus ScriptedBulkTransport::control_out(const ControlRequest& request,
                                                   rt::Duration) noexcept {
  if (closed_ || !falcon_->plugged()) {
    return gone();
  }
  return falcon_->control(request) ? TransportStatus::kOk : TransportStatus::kTimeout;
}

}  // namespace forcegrid::driver
