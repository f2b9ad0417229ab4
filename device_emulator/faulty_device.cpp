// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/faulty_device.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

#include "device_emulator/fault_descriptors.h"
#include "device_emulator/usb_numbers.h"

namespace forcegrid::emulator {

namespace {

constexpr rt::Duration kPushingFor = std::chrono::milliseconds(500);
constexpr std::size_t kCounters = 3;         // of the arm's joints, or motors
constexpr std::size_t kCountersOfWrist = 6;  // and those of a wrist behind them, in W2 and W3
constexpr std::size_t kCommandWord = 3;
constexpr std::size_t kFirstWristWord = 7;  // currents of the wrist's joints, in W6
constexpr std::size_t kModemStatusBytes = 2;
constexpr std::size_t kMostReportBytes = 64;

// A Falcon's packet: '<', three values of four nibbles each, the least significant first, each a
// character from 0x41 on, two bytes more, '>'. Source: device fact sheet, section 5.
constexpr std::size_t kFalconPacketBytes = 16;
constexpr std::uint8_t kFalconBegin = '<';
constexpr std::uint8_t kFalconEnd = '>';
constexpr std::size_t kFalconFirstValue = 1;
constexpr std::uint8_t kFalconZero = 0x41;
constexpr std::size_t kFalconNibbles = 4;

std::int16_t word_at(std::span<const std::uint8_t> bytes, std::size_t index) {
  return static_cast<std::int16_t>(
      static_cast<std::uint16_t>(bytes[2 * index] | (bytes[2 * index + 1] << 8)));
}

void put_word(std::span<std::uint8_t> bytes, std::size_t index, std::int16_t value) {
  const auto bits = static_cast<std::uint16_t>(value);
  bytes[2 * index] = static_cast<std::uint8_t>(bits & 0xFFU);
  bytes[2 * index + 1] = static_cast<std::uint8_t>(bits >> 8);
}

/// Refuses faults that a device of `protocol` can't have.
void check_fits(const FaultSpec& spec, const std::string& protocol) {
  const FaultKind kind = spec.kind;
  const bool hid = protocol == "w2" || protocol == "w3" || protocol == "w6";
  const bool falcon = protocol == "falcon";
  const auto refuse = [&](const char* why, const char* with) {
    throw std::invalid_argument(std::string("fault '") + name_of(kind) + "' " + why +
                                " protocol '" + protocol + "'; use it with a " + with + " device");
  };
  switch (kind) {
    case FaultKind::kCorruptReport:
    case FaultKind::kFrozenEncoder:
    case FaultKind::kJumpingEncoder:
    case FaultKind::kWrappingEncoder:
    case FaultKind::kSaturatedEncoder:
    case FaultKind::kWrongWayMotor:
      if (spec.axis && *spec.axis >= static_cast<int>(kCounters)) {
        if (kind == FaultKind::kWrongWayMotor && protocol != "w6") {
          refuse("of axis d, e or f needs motors that a wrist does not have with", "w6");
        }
        if (!hid) {
          refuse("of axis d, e or f needs counters that are not in a packet of", "w2 or w3");
        }
      }
      if (!hid && !falcon) {
        refuse("changes counters or motors, and their place in a packet is unknown with",
               "w2, w3 or falcon");
      }
      return;
    case FaultKind::kWatchdogTrip:
      if (!hid) {
        refuse("needs firmware that answers reports without acting on them, unlike", "w2 or w3");
      }
      return;
    case FaultKind::kStatusOnly:
    case FaultKind::kWrongEcho:
    case FaultKind::kStuckBootLoader:
      if (!falcon) {
        refuse("needs a serial chip and a boot loader, unlike", "falcon");
      }
      return;
    default:
      return;
  }
}

}  // namespace

/// The values of one report or of one command, in the bytes that carry them.
class FaultyDevice::Counters {
 public:
  /// @param nibbles four characters per value (Falcon); else two bytes, the lower first.
  Counters(std::span<std::uint8_t> bytes, bool nibbles) : bytes_(bytes), nibbles_(nibbles) {}

  [[nodiscard]] std::size_t size() const { return bytes_.size() / (nibbles_ ? kFalconNibbles : 2); }

  [[nodiscard]] std::int16_t get(std::size_t axis) const {
    if (!nibbles_) {
      return word_at(bytes_, axis);
    }
    unsigned bits = 0;
    for (std::size_t i = 0; i < kFalconNibbles; ++i) {
      bits |= static_cast<unsigned>((bytes_[kFalconNibbles * axis + i] - kFalconZero) & 0xF)
              << (4 * i);
    }
    return static_cast<std::int16_t>(static_cast<std::uint16_t>(bits));
  }
  void put(std::size_t axis, std::int16_t value) {
    if (!nibbles_) {
      put_word(bytes_, axis, value);
      return;
    }
    const auto bits = static_cast<std::uint16_t>(value);
    for (std::size_t i = 0; i < kFalconNibbles; ++i) {
      bytes_[kFalconNibbles * axis + i] =
          static_cast<std::uint8_t>(kFalconZero + ((bits >> (4 * i)) & 0xF));
    }
  }

 private:
  std::span<std::uint8_t> bytes_;
  bool nibbles_;
};

struct FaultyDevice::Fault {
  explicit Fault(const FaultSpec& s) : spec(s), random(s.seed) {}

  FaultSpec spec;
  std::mt19937_64 random;
  std::optional<rt::TimePoint> began{};
  bool active = false;
  std::uint64_t seen = 0;   // reports since the fault began
  std::uint64_t acted = 0;  // how often it did something
  std::optional<rt::TimePoint> first_acted{};
  std::optional<std::array<std::int16_t, kCountersOfWrist>> counters_at_start{};

  [[nodiscard]] bool touches(std::size_t axis) const {
    return spec.axis ? *spec.axis == static_cast<int>(axis) : axis < kCounters;
  }
  void act(rt::TimePoint now) {
    ++acted;
    if (!first_acted) {
      first_acted = now;
    }
  }
};

/// The host as the device sees it, through the faults.
class FaultyDevice::Host final : public UsbHost {
 public:
  Host(FaultyDevice& device, UsbHost& host) : device_(device), host_(host) {}

  std::optional<std::span<const std::uint8_t>> out_packet(std::uint8_t endpoint_address) override {
    if (device_.busy_until_ > device_.now_) {
      return std::nullopt;
    }
    auto packet = host_.out_packet(endpoint_address);
    if (!packet) {
      return packet;
    }
    if (Fault* nak = device_.acting(FaultKind::kNakOut)) {
      nak->act(device_.now_);
      return std::nullopt;
    }
    return device_.spoil_out(*packet);
  }

  void take_out(std::uint8_t endpoint_address) override {
    host_.take_out(endpoint_address);
    for (const FaultKind kind : {FaultKind::kWrongWayMotor, FaultKind::kWatchdogTrip}) {
      if (Fault* fault = device_.acting(kind)) {
        fault->act(device_.now_);
      }
    }
    if (Fault* slow = device_.acting(FaultKind::kSlowFirmware)) {
      slow->act(device_.now_);
      device_.busy_until_ = device_.now_ + rt::from_seconds(1e-3 * slow->spec.milliseconds);
    }
  }

  void babble(std::uint8_t endpoint_address) override { host_.babble(endpoint_address); }
  void overfill(std::uint8_t endpoint_address) override { host_.overfill(endpoint_address); }

  bool wants_in(std::uint8_t endpoint_address) override {
    return device_.busy_until_ <= device_.now_ && host_.wants_in(endpoint_address);
  }

  bool give_in(std::uint8_t endpoint_address, std::span<const std::uint8_t> packet) override {
    return device_.give_in(host_, endpoint_address, packet);
  }

 private:
  FaultyDevice& device_;
  UsbHost& host_;
};

FaultyDevice::FaultyDevice(std::unique_ptr<EmulatedDevice> device,
                           const profiles::DeviceProfile& profile,
                           const std::vector<FaultSpec>& faults, rt::TimePoint start)
    : device_(std::move(device)), has_modem_status_(profile.usb.protocol == "falcon"), now_(start) {
  if (profile.gimbal_motors.present) {
    wrist_motors_ = profile.gimbal.counter;
  }
  for (const FaultSpec& spec : faults) {
    check_fits(spec, profile.usb.protocol);
    faults_.emplace_back(spec);
  }
  device_->set_boot_loader_faults(this);
  begin_what_is_due(start);
}

FaultyDevice::~FaultyDevice() = default;

std::uint8_t FaultyDevice::echo(std::uint64_t image_byte, std::uint8_t character) noexcept {
  Fault* const wrong = acting(FaultKind::kWrongEcho);
  if (wrong == nullptr || image_byte != wrong->spec.image_byte) {
    return character;
  }
  wrong->act(now_);
  return character ^ 1U;
}

bool FaultyDevice::stuck_at(BootStep step) noexcept {
  Fault* const stuck = acting(FaultKind::kStuckBootLoader);
  if (stuck == nullptr || step != stuck->spec.boot_step) {
    return false;
  }
  stuck->act(now_);
  return true;
}

std::vector<FaultyDevice::Counters> FaultyDevice::counters_in(std::span<std::uint8_t> packet,
                                                              std::size_t prefix) const {
  std::vector<Counters> found;
  if (!has_modem_status_) {
    for (const std::size_t counters : {kCountersOfWrist, kCounters}) {
      if (found.empty() && packet.size() >= prefix + 2 * counters) {
        found.emplace_back(packet.subspan(prefix, 2 * counters), false);
      }
    }
    return found;
  }
  for (std::size_t at = prefix; at + kFalconPacketBytes <= packet.size();) {
    if (packet[at] != kFalconBegin || packet[at + kFalconPacketBytes - 1] != kFalconEnd) {
      ++at;  // the rest of a value that began in the packet before
      continue;
    }
    found.emplace_back(packet.subspan(at + kFalconFirstValue, kFalconNibbles * kCounters), true);
    at += kFalconPacketBytes;
  }
  return found;
}

const FaultyDevice::Fault* FaultyDevice::active(FaultKind kind) const noexcept {
  for (const Fault& fault : faults_) {
    if (fault.spec.kind == kind && fault.active) {
      return &fault;
    }
  }
  return nullptr;
}

FaultyDevice::Fault* FaultyDevice::acting(FaultKind kind) noexcept {
  return const_cast<Fault*>(std::as_const(*this).active(kind));
}

void FaultyDevice::begin_what_is_due(rt::TimePoint now) {
  now_ = now;
  if (device_->motors_on()) {
    motors_last_on_ = now;
    if (!motors_on_since_) {
      motors_on_since_ = now;
    }
  } else {
    motors_on_since_.reset();
  }
  if (device_->configured() && !first_configured_) {
    first_configured_ = now;
  }
  for (Fault& fault : faults_) {
    const FaultSpec& spec = fault.spec;
    if (!fault.began) {
      const bool due = spec.start == FaultSpec::Start::kPowerUp ||
                       (spec.start == FaultSpec::Start::kMotors && motors_on_since_ &&
                        now - *motors_on_since_ >= kPushingFor) ||
                       (spec.start == FaultSpec::Start::kSeconds && first_configured_ &&
                        rt::seconds(now - *first_configured_) >= spec.start_s);
      if (due) {
        fault.began = now;
      }
    }
    fault.active = fault.began &&
                   (spec.duration_s <= 0.0 || rt::seconds(now - *fault.began) < spec.duration_s) &&
                   (spec.count == 0 || fault.acted < spec.count);
  }
  // A stalled endpoint acts by being stalled.
  for (const FaultKind kind : {FaultKind::kStallIn, FaultKind::kStallOut}) {
    if (Fault* fault = acting(kind); fault != nullptr && fault->acted == 0) {
      fault->act(now);
    }
  }
  const auto leave = [&](Fault& fault) {
    fault.act(now);
    plugged_in_ = false;
    unplugged_until_ = now + rt::from_seconds(1e-3 * fault.spec.milliseconds);
    late_.clear();
  };
  plugged_in_ = plugged_in_ || now >= unplugged_until_;
  if (plugged_in_) {
    if (Fault* reboot = acting(FaultKind::kFirmwareReboot)) {
      device_->power_cycle(now);
      leave(*reboot);
    } else if (Fault* closed = acting(FaultKind::kConnectionClosed)) {
      leave(*closed);
    }
  }
}

bool FaultyDevice::hits(Fault& fault) {
  ++fault.seen;
  if (fault.seen % fault.spec.every != 0) {
    return false;
  }
  if (fault.spec.probability < 1.0 &&
      std::uniform_real_distribution<double>()(fault.random) >= fault.spec.probability) {
    return false;
  }
  fault.act(now_);
  return true;
}

bool FaultyDevice::halted(std::uint8_t endpoint_address) const noexcept {
  const bool in = (endpoint_address & 0x80U) != 0;
  return device_->halted(endpoint_address) ||
         active(in ? FaultKind::kStallIn : FaultKind::kStallOut) != nullptr;
}

ControlReply FaultyDevice::control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                                   rt::TimePoint now) {
  begin_what_is_due(now);
  if (Fault* stall = acting(FaultKind::kStallControl)) {
    stall->act(now);
    return {};
  }
  Fault* const malformed = acting(FaultKind::kMalformedDescriptors);
  if (malformed == nullptr || !setup.device_to_host() || setup.request != usb::kGetDescriptor) {
    return device_->control(setup, data, now);
  }
  // Mutates the whole descriptor, whatever part of it the host asks for.
  SetupPacket whole = setup;
  whole.length = std::numeric_limits<std::uint16_t>::max();
  ControlReply reply = device_->control(whole, data, now);
  if (reply.stalled) {
    return reply;
  }
  auto mutated =
      DescriptorMutations(malformed->spec.seed, attachments_)
          .apply(static_cast<std::uint8_t>(setup.value >> 8),
                 static_cast<std::uint8_t>(setup.value & 0xFFU), setup.index, reply.data);
  if (!mutated || *mutated != reply.data) {
    malformed->act(now);
  }
  if (!mutated) {
    return {};
  }
  mutated->resize(std::min<std::size_t>(mutated->size(), setup.length));
  return {false, std::move(*mutated)};
}

void FaultyDevice::run(rt::TimePoint now, UsbHost& host) {
  device_->advance_to(now);
  begin_what_is_due(now);
  deliver_late_reports(host);
  Host through(*this, host);
  device_->run(now, through);
}

void FaultyDevice::deliver_late_reports(UsbHost& host) {
  while (!late_.empty() && late_.front().due <= now_ &&
         host.wants_in(late_.front().endpoint_address)) {
    const LateReport report = std::move(late_.front());
    late_.pop_front();
    static_cast<void>(host.give_in(report.endpoint_address, report.bytes));
  }
}

std::optional<rt::TimePoint> FaultyDevice::wake_time() const noexcept {
  auto wake = device_->wake_time();
  if (wake && !late_.empty()) {
    wake = std::min(*wake, late_.front().due);
  }
  return wake;
}

void FaultyDevice::advance_to(rt::TimePoint now) noexcept { device_->advance_to(now); }

void FaultyDevice::bus_reset(rt::TimePoint now) noexcept {
  device_->bus_reset(now);
  ++attachments_;
  late_.clear();
  busy_until_ = now;
}

void FaultyDevice::spoil_counters(std::vector<std::uint8_t>& report) {
  const std::size_t prefix = has_modem_status_ ? kModemStatusBytes : 0;
  for (Counters& counters : counters_in(report, prefix)) {
    std::array<std::int16_t, kCountersOfWrist> true_counters{};
    for (std::size_t i = 0; i < counters.size(); ++i) {
      true_counters[i] = counters.get(i);
    }
    for (Fault& fault : faults_) {
      const FaultKind kind = fault.spec.kind;
      const bool of_encoders =
          kind == FaultKind::kFrozenEncoder || kind == FaultKind::kJumpingEncoder ||
          kind == FaultKind::kWrappingEncoder || kind == FaultKind::kSaturatedEncoder;
      if (!fault.active || !of_encoders || !hits(fault)) {
        continue;
      }
      if (!fault.counters_at_start) {
        fault.counters_at_start = true_counters;
      }
      for (std::size_t i = 0; i < counters.size(); ++i) {
        if (!fault.touches(i)) {
          continue;
        }
        const std::int32_t start = (*fault.counters_at_start)[i];
        std::int32_t value = counters.get(i);
        if (kind == FaultKind::kFrozenEncoder) {
          value = start;
        } else if (kind == FaultKind::kJumpingEncoder) {
          value += fault.spec.counts;
        } else if (kind == FaultKind::kSaturatedEncoder) {
          value = std::numeric_limits<std::int16_t>::max();
        } else {
          const std::int32_t range = 1 << fault.spec.bits;
          std::int32_t moved = (value - start) % range;
          moved += moved < -range / 2 ? range : (moved >= range / 2 ? -range : 0);
          value = start + moved;
        }
        counters.put(i, static_cast<std::int16_t>(value));
      }
    }
  }
}

void FaultyDevice::spoil_bytes(std::vector<std::uint8_t>& report) {
  const std::size_t prefix = has_modem_status_ ? kModemStatusBytes : 0;
  if (Fault* corrupt = acting(FaultKind::kCorruptReport)) {
    for (Counters& counters : counters_in(report, prefix)) {
      if (!hits(*corrupt)) {
        continue;
      }
      for (std::size_t i = 0; i < kCounters; ++i) {
        const auto random = static_cast<std::uint16_t>(corrupt->random());
        const auto bits = static_cast<std::uint16_t>(counters.get(i));
        const int spoilt =
            corrupt->spec.small_corruption ? (bits & ~3) | (random & 3) : static_cast<int>(random);
        counters.put(i, static_cast<std::int16_t>(static_cast<std::uint16_t>(spoilt)));
      }
    }
  }
  for (const FaultKind kind : {FaultKind::kShortReport, FaultKind::kLongReport}) {
    if (Fault* length = acting(kind); length != nullptr && hits(*length)) {
      report.resize(std::min(kMostReportBytes, prefix + length->spec.bytes));
    }
  }
}

bool FaultyDevice::give_in(UsbHost& host, std::uint8_t endpoint_address,
                           std::span<const std::uint8_t> packet) {
  if (has_modem_status_ && packet.size() <= kModemStatusBytes) {
    return host.give_in(endpoint_address, packet);  // it carries nothing
  }
  if (Fault* status_only = acting(FaultKind::kStatusOnly)) {
    status_only->act(now_);
    return host.give_in(endpoint_address, packet.first(kModemStatusBytes));
  }
  if (Fault* babble = acting(FaultKind::kBabble)) {
    babble->act(now_);
    host.babble(endpoint_address);
    return false;
  }
  if (Fault* too_much = acting(FaultKind::kOverLongPayload)) {
    too_much->act(now_);
    host.overfill(endpoint_address);
    return true;  // for the device everything went as usual
  }
  std::vector<std::uint8_t> report(packet.begin(), packet.end());
  spoil_counters(report);
  spoil_bytes(report);
  if (Fault* drop = acting(FaultKind::kDropReport); drop != nullptr && hits(*drop)) {
    return true;
  }
  Fault* const late = acting(FaultKind::kLateReport);
  const bool is_late = late != nullptr && hits(*late);
  if (is_late || !late_.empty()) {  // what follows a late report stays behind it
    const double delay_s = is_late ? 1e-3 * late->spec.milliseconds : 0.0;
    late_.push_back({now_ + rt::from_seconds(delay_s), endpoint_address, std::move(report)});
    return true;
  }
  if (!host.give_in(endpoint_address, report)) {
    return false;
  }
  if (Fault* twice = acting(FaultKind::kDuplicateReport); twice != nullptr && hits(*twice)) {
    late_.push_back({now_, endpoint_address, std::move(report)});
  }
  return true;
}

std::span<const std::uint8_t> FaultyDevice::spoil_out(std::span<const std::uint8_t> packet) {
  Fault* const wrong_way = acting(FaultKind::kWrongWayMotor);
  Fault* const trip = acting(FaultKind::kWatchdogTrip);
  if (wrong_way == nullptr && trip == nullptr) {
    return packet;
  }
  const std::size_t shortest = has_modem_status_ ? kFalconPacketBytes : 2 * (kCommandWord + 1);
  if (packet.size() < shortest) {
    return packet;
  }
  out_.assign(packet.begin(), packet.end());
  if (wrong_way != nullptr && (has_modem_status_ || word_at(out_, kCommandWord) == 0)) {
    turn_commands(*wrong_way);
  }
  if (trip != nullptr) {
    // The firmware answers what it takes for a report of another length, and does nothing with it.
    out_.pop_back();
  }
  return out_;
}

void FaultyDevice::turn_commands(const Fault& wrong_way) {
  const auto turned = [](std::int16_t command) {
    return static_cast<std::int16_t>(
        std::min<int>(-command, std::numeric_limits<std::int16_t>::max()));
  };
  for (Counters& commands : counters_in(out_, 0)) {
    for (std::size_t i = 0; i < kCounters; ++i) {
      if (wrong_way.touches(i)) {
        commands.put(i, turned(commands.get(i)));
      }
    }
  }
  if (!wrist_motors_ || out_.size() < 2 * (kFirstWristWord + wrist_motors_->size())) {
    return;
  }
  for (std::size_t i = 0; i < wrist_motors_->size(); ++i) {
    if (wrong_way.touches(static_cast<std::size_t>((*wrist_motors_)[i]))) {
      put_word(out_, kFirstWristWord + i, turned(word_at(out_, kFirstWristWord + i)));
    }
  }
}

EmulatorReport FaultyDevice::report() const {
  EmulatorReport report = device_->report();
  const bool on = device_->motors_on();
  for (const Fault& fault : faults_) {
    FaultRecord record;
    record.name = name_of(fault.spec.kind);
    record.times = fault.acted;
    if (fault.first_acted) {
      record.first_ns = std::chrono::nanoseconds(fault.first_acted->time_since_epoch()).count();
      if (!on) {
        record.seconds_until_motors_off =
            motors_last_on_ ? std::max(0.0, rt::seconds(*motors_last_on_ - *fault.first_acted))
                            : 0.0;
      }
    }
    report.faults.push_back(record);
  }
  if (motors_last_on_) {
    report.motors_last_on_ns =
        std::chrono::nanoseconds(motors_last_on_->time_since_epoch()).count();
  }
  return report;
}

}  // namespace forcegrid::emulator
