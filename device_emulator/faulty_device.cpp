#include "device_emulator/faulty_device.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

#include "device_emulator/fault_descriptors.h"

namespace forcegrid::emulator {

namespace {

constexpr rt::Duration kPushingFor = std::chrono::milliseconds(500);
constexpr std::uint8_t kGetDescriptor = 6;
constexpr std::size_t kCounters = 3;
constexpr std::size_t kCommandWord = 3;
constexpr std::size_t kModemStatusBytes = 2;
constexpr std::size_t kMostReportBytes = 64;

std::int16_t word(std::span<const std::uint8_t> bytes, std::size_t index) {
  return static_cast<std::int16_t>(
      static_cast<std::uint16_t>(bytes[2 * index] | (bytes[2 * index + 1] << 8)));
}

void put_word(std::span<std::uint8_t> bytes, std::size_t index, std::int16_t value) {
  const auto bits = static_cast<std::uint16_t>(value);
  bytes[2 * index] = static_cast<std::uint8_t>(bits & 0xFFU);
  bytes[2 * index + 1] = static_cast<std::uint8_t>(bits >> 8);
}

bool needs_counters(FaultKind kind) {
  switch (kind) {
    case FaultKind::kCorruptReport:
    case FaultKind::kFrozenEncoder:
    case FaultKind::kJumpingEncoder:
    case FaultKind::kWrappingEncoder:
    case FaultKind::kSaturatedEncoder:
    case FaultKind::kWatchdogTrip:
    case FaultKind::kWrongWayMotor:
      return true;
    default:
      return false;
  }
}

}  // namespace

struct FaultyDevice::Fault {
  explicit Fault(const FaultSpec& s) : spec(s), random(s.seed) {}

  FaultSpec spec;
  std::mt19937_64 random;
  std::optional<rt::TimePoint> began{};
  bool active = false;
  std::uint64_t seen = 0;   // reports since it began
  std::uint64_t acted = 0;  // times it did something
  std::optional<rt::TimePoint> first_acted{};
  std::optional<std::array<std::int16_t, kCounters>> counters_at_start{};

  [[nodiscard]] bool touches(std::size_t axis) const {
    return !spec.axis || *spec.axis == static_cast<int>(axis);
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

FaultyDevice::FaultyDevice(std::unique_ptr<EmulatedDevice> device, const std::string& protocol,
                           const std::vector<FaultSpec>& faults, rt::TimePoint start)
    : device_(std::move(device)), has_modem_status_(protocol == "falcon"), now_(start) {
  const bool has_counters = protocol == "w2" || protocol == "w3";
  for (const FaultSpec& spec : faults) {
    if (needs_counters(spec.kind) && !has_counters) {
      throw std::invalid_argument(std::string("fault '") + name_of(spec.kind) +
                                  "' needs reports whose counters are known, which protocol '" +
                                  protocol + "' does not have here; use it with a w2 or w3 device");
    }
    faults_.emplace_back(spec);
  }
  begin_what_is_due(start);
}

FaultyDevice::~FaultyDevice() = default;

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
  // Endpoints that stall act by being so.
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
  if (malformed == nullptr || !setup.device_to_host() || setup.request != kGetDescriptor) {
    return device_->control(setup, data, now);
  }
  // All of it is mutated, whatever part of it is asked for.
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
  if (report.size() < 2 * kCounters) {
    return;
  }
  std::array<std::int16_t, kCounters> true_counters{};
  for (std::size_t i = 0; i < kCounters; ++i) {
    true_counters[i] = word(report, i);
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
    for (std::size_t i = 0; i < kCounters; ++i) {
      if (!fault.touches(i)) {
        continue;
      }
      const std::int32_t start = (*fault.counters_at_start)[i];
      std::int32_t value = word(report, i);
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
      put_word(report, i, static_cast<std::int16_t>(value));
    }
  }
}

void FaultyDevice::spoil_bytes(std::vector<std::uint8_t>& report) {
  if (Fault* corrupt = acting(FaultKind::kCorruptReport);
      corrupt != nullptr && report.size() >= 2 * kCounters && hits(*corrupt)) {
    for (std::size_t i = 0; i < kCounters; ++i) {
      const auto random = static_cast<std::uint16_t>(corrupt->random());
      const auto bits = static_cast<std::uint16_t>(word(report, i));
      const int spoilt =
          corrupt->spec.small_corruption ? (bits & ~3) | (random & 3) : static_cast<int>(random);
      put_word(report, i, static_cast<std::int16_t>(static_cast<std::uint16_t>(spoilt)));
    }
  }
  const std::size_t prefix = has_modem_status_ ? kModemStatusBytes : 0;
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
  if (Fault* babble = acting(FaultKind::kBabble)) {
    babble->act(now_);
    host.babble(endpoint_address);
    return false;
  }
  if (Fault* too_much = acting(FaultKind::kOverLongPayload)) {
    too_much->act(now_);
    host.overfill(endpoint_address);
    return true;  // for the device everything was as usual
  }
  std::vector<std::uint8_t> report(packet.begin(), packet.end());
  spoil_counters(report);
  spoil_bytes(report);
  if (Fault* drop = acting(FaultKind::kDropReport); drop != nullptr && hits(*drop)) {
    return true;
  }
  Fault* const late = acting(FaultKind::kLateReport);
  const bool is_late = late != nullptr && hits(*late);
  if (is_late || !late_.empty()) {  // what comes after a late report comes after it
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
  if ((wrong_way == nullptr && trip == nullptr) || packet.size() < 2 * (kCommandWord + 1)) {
    return packet;
  }
  out_.assign(packet.begin(), packet.end());
  if (wrong_way != nullptr && word(out_, kCommandWord) == 0) {
    for (std::size_t i = 0; i < kCounters; ++i) {
      if (wrong_way->touches(i)) {
        const int turned = std::min<int>(-word(out_, i), std::numeric_limits<std::int16_t>::max());
        put_word(out_, i, static_cast<std::int16_t>(turned));
      }
    }
  }
  if (trip != nullptr) {
    // What the firmware takes for a report of another length it answers, and does nothing about.
    out_.pop_back();
  }
  return out_;
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
