// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/falcon_firmware.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::emulator {

namespace {

constexpr std::array<std::uint8_t, 3> kGreeting = {'\n', 'C', '\r'};
constexpr std::array<std::uint8_t, 4> kGreetingReply = {'\n', 'D', ',', '\r'};
constexpr std::uint16_t kImageKey = 0x08AA;
constexpr std::size_t kHeaderWords = 10;  // eight reserved and the entry address
constexpr std::size_t kAddressWords = 2;

constexpr std::uint8_t kPacketBegin = '<';
constexpr std::uint8_t kPacketEnd = '>';
constexpr std::uint8_t kPayloadZero = 0x41;
constexpr std::size_t kStatusByte = 13;
constexpr std::size_t kUnusedByte = 14;
constexpr std::size_t kValueBytes = 4;
constexpr std::uint8_t kHomingBit = 0x01;
constexpr std::uint8_t kLightBits = 0x0E;

bool near(double baud_Hz, double nominal_Hz) {
  return std::abs(baud_Hz / nominal_Hz - 1.0) <= Ft232r::kBaudTolerance;
}

}  // namespace

FalconFirmware::FalconFirmware(const profiles::DeviceProfile& profile, Board& board,
                               std::uint64_t seed, bool running, bool homed)
    : board_(board),
      rad_per_count_(profile.delta.encoder_rad_per_count),
      zero_angle_rad_(profile.delta.zero_angle_rad),
      command_limit_(profile.falcon.command_limit),
      homing_out_rad_(profile.falcon.homing_out_rad),
      homing_in_rad_(profile.falcon.homing_in_rad),
      random_(seed) {
  lose_zeros();
  if (running) {
    state_ = State::kRunning;
  }
  if (running && homed) {
    homed_.fill(true);
    offset_counts_.fill(0);
  }
}

void FalconFirmware::lose_zeros() noexcept {
  homed_.fill(false);
  been_out_.fill(false);
  for (std::int32_t& offset : offset_counts_) {
    offset =
        static_cast<std::int32_t>(random_() % (2 * kOffsetRange_counts + 1)) - kOffsetRange_counts;
  }
}

void FalconFirmware::cut_motors() noexcept {
  commands_.fill(0);
  watchdog_running_ = false;
}

void FalconFirmware::modem_lines_changed(const LineSettings& line,
                                         rt::TimePoint /*time*/) noexcept {
  const bool rising = line.dtr && !dtr_;
  dtr_ = line.dtr;
  if (rising && near(line.baud_Hz, kBootBaud_Hz)) {
    start_boot_loader();
  }
}

void FalconFirmware::start_boot_loader() noexcept {
  state_ = State::kCold;
  greeting_matched_ = 0;
  last_packet_.reset();
  lights_ = 0;
  homing_ = false;
  cut_motors();
}

void FalconFirmware::power_up() noexcept {
  start_boot_loader();
  lose_zeros();
}

void FalconFirmware::receive(std::uint8_t character, const LineSettings& line,
                             rt::TimePoint time) noexcept {
  if (!line.is_8n1()) {
    return;
  }
  switch (state_) {
    case State::kCold:
    case State::kAutoBaud:
      boot(character, line, time);
      break;
    case State::kLoading:
      if (near(line.baud_Hz, kLoaderBaud_Hz)) {
        load(character, line, time);
      }
      break;
    case State::kRunning:
      if (near(line.baud_Hz, kRunBaud_Hz)) {
        run(character, time);
      }
      break;
  }
}

void FalconFirmware::boot(std::uint8_t character, const LineSettings& line,
                          rt::TimePoint time) noexcept {
  if (state_ == State::kAutoBaud && !dtr_ && near(line.baud_Hz, kLoaderBaud_Hz) &&
      (character == 'A' || character == 'a')) {
    if (stuck_at(BootStep::kBaudRate)) {
      return;
    }
    state_ = State::kLoading;
    section_ = Section::kKey;
    low_byte_.reset();
    image_byte_ = 0;
    board_.send(std::span(&character, 1), line.baud_Hz, time);
    return;
  }
  if (!near(line.baud_Hz, kBootBaud_Hz)) {
    greeting_matched_ = 0;
    return;
  }
  if (character != kGreeting[greeting_matched_]) {
    greeting_matched_ = character == kGreeting[0] ? 1 : 0;
    return;
  }
  if (++greeting_matched_ == kGreeting.size()) {
    greeting_matched_ = 0;
    if (stuck_at(BootStep::kGreeting)) {
      return;
    }
    state_ = State::kAutoBaud;
    ++statistics_.handshakes;
    board_.send(kGreetingReply, line.baud_Hz, time);
  }
}

void FalconFirmware::load(std::uint8_t character, const LineSettings& line,
                          rt::TimePoint time) noexcept {
  ++statistics_.bytes_loaded;
  const std::uint8_t echo = faults_ != nullptr ? faults_->echo(image_byte_, character) : character;
  ++image_byte_;
  board_.send(std::span(&echo, 1), line.baud_Hz, time);
  if (!low_byte_) {
    low_byte_ = character;
    return;
  }
  const auto word = static_cast<std::uint16_t>(*low_byte_ | (character << 8));
  low_byte_.reset();
  load_word(word);
}

void FalconFirmware::load_word(std::uint16_t word) noexcept {
  switch (section_) {
    case Section::kKey:
      if (word != kImageKey) {
        ++statistics_.wrong_keys;
        section_ = Section::kRefused;
        return;
      }
      section_ = Section::kHeader;
      words_left_ = kHeaderWords;
      return;
    case Section::kHeader:
      if (--words_left_ == 0) {
        section_ = Section::kBlockSize;
      }
      return;
    case Section::kBlockSize:
      if (word == 0) {
        if (stuck_at(BootStep::kStart)) {
          section_ = Section::kRefused;
        } else {
          start_firmware();
        }
        return;
      }
      section_ = Section::kBlock;
      words_left_ = kAddressWords + word;
      return;
    case Section::kBlock:
      if (--words_left_ == 0) {
        section_ = Section::kBlockSize;
      }
      return;
    case Section::kRefused:
      return;
  }
}

void FalconFirmware::start_firmware() noexcept {
  state_ = State::kRunning;
  packet_size_ = 0;
  ++statistics_.firmware_starts;
  lose_zeros();
}

void FalconFirmware::run(std::uint8_t character, rt::TimePoint time) noexcept {
  if (character == kPacketBegin) {
    // Never within a packet: the packet that had begun is then malformed.
    statistics_.malformed_packets += packet_size_ > 0 ? 1 : 0;
    packet_size_ = 0;
  } else if (packet_size_ == 0) {
    return;
  }
  packet_[packet_size_++] = character;
  const bool value = packet_size_ > 1 && packet_size_ - 1 <= kStatusByte;
  if (value && (character < kPayloadZero || character > kPayloadZero + 0x0F)) {
    ++statistics_.malformed_packets;
    packet_size_ = 0;
    return;
  }
  if (packet_size_ < kPacketBytes) {
    return;
  }
  packet_size_ = 0;
  if (character != kPacketEnd) {
    ++statistics_.malformed_packets;
    return;
  }
  answer(time);
}

void FalconFirmware::answer(rt::TimePoint time) noexcept {
  // The angles are those of this moment, before the new commands act.
  const std::array<double, 3> joint_angle_rad = board_.joint_angle_rad(time);
  for (std::size_t motor = 0; motor < 3; ++motor) {
    unsigned bits = 0;
    for (std::size_t nibble = 0; nibble < kValueBytes; ++nibble) {
      bits |= static_cast<unsigned>(packet_[1 + kValueBytes * motor + nibble] - kPayloadZero)
              << (4 * nibble);
    }
    const std::int32_t asked = static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
    commands_[motor] = std::clamp(asked, -command_limit_, command_limit_);
    statistics_.saturated_commands += commands_[motor] != asked ? 1 : 0;
  }
  const auto status = static_cast<std::uint8_t>(packet_[kStatusByte] - kPayloadZero);
  homing_ = (status & kHomingBit) != 0;
  lights_ = status & kLightBits;
  last_packet_ = time;
  watchdog_running_ = true;
  ++statistics_.packets_answered;

  std::array<std::uint8_t, kPacketBytes> reply{};
  reply[0] = kPacketBegin;
  const std::array<std::int32_t, 3> counts = counters(joint_angle_rad);
  unsigned flags = buttons_;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto bits = static_cast<std::uint16_t>(counts[axis]);
    for (std::size_t nibble = 0; nibble < kValueBytes; ++nibble) {
      reply[1 + kValueBytes * axis + nibble] =
          static_cast<std::uint8_t>(kPayloadZero + (bits >> (4 * nibble) & 0x0F));
    }
    flags |= homing_ && homed_[axis] ? 0x10U << axis : 0U;
  }
  reply[kStatusByte] = static_cast<std::uint8_t>(kPayloadZero + flags);
  reply[kUnusedByte] = kPayloadZero;
  reply[kPacketBytes - 1] = kPacketEnd;
  board_.send(reply, kRunBaud_Hz, time);
}

void FalconFirmware::turn(const std::array<double, 3>& joint_angle_rad) noexcept {
  if (state_ != State::kRunning || !homing_ || all_homed()) {
    return;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    been_out_[axis] = been_out_[axis] || joint_angle_rad[axis] > homing_out_rad_;
    if (!homed_[axis] && been_out_[axis] && joint_angle_rad[axis] < homing_in_rad_) {
      homed_[axis] = true;
      offset_counts_[axis] = 0;
    }
  }
  statistics_.homings += all_homed() ? 1 : 0;
}

std::optional<rt::TimePoint> FalconFirmware::watchdog_deadline() const noexcept {
  return watchdog_running_ ? std::optional(*last_packet_ + kWatchdog) : std::nullopt;
}

void FalconFirmware::check_watchdog(rt::TimePoint now) noexcept {
  if (watchdog_running_ && now - *last_packet_ >= kWatchdog) {
    cut_motors();
    ++statistics_.watchdog_trips;
  }
}

std::array<std::int32_t, 3> FalconFirmware::counters(
    const std::array<double, 3>& joint_angle_rad) const noexcept {
  std::array<std::int32_t, 3> result{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto counts = static_cast<std::int32_t>(
        std::lround((joint_angle_rad[axis] - zero_angle_rad_) / rad_per_count_));
    // The packet has only 16 bits of it.
    result[axis] = static_cast<std::int16_t>(
        static_cast<std::uint16_t>(static_cast<std::uint32_t>(counts + offset_counts_[axis])));
  }
  return result;
}

const char* FalconFirmware::name_of(State state) noexcept {
  switch (state) {
    case State::kCold:
      return "cold";
    case State::kAutoBaud:
      return "auto-baud";
    case State::kLoading:
      return "loading";
    case State::kRunning:
      return "running";
  }
  return "unknown";
}

}  // namespace forcegrid::emulator
