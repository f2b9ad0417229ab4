// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulated_falcon.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "rt/vectors.h"

namespace forcegrid::emulator {

namespace {

using Eigen::Vector3d;

constexpr std::uint8_t kCentreButton = 0x04;
// The operator pulls and pushes past the stops, so that a light hand reaches them too.
constexpr double kBeyondStop_m = 0.003;

const Vector3d kStart_D(0.0, 0.0, EmulatedFalcon::kStartHeight_m);

OperatorScript::Options script_options(const DeviceOptions& options) {
  OperatorScript::Options script =
      OperatorScript::on_device(options.operator_script, options.profile);
  const auto& delta = options.profile.delta;
  const double out_m = delta.knob_max_z_m - delta.center_m[2] + kBeyondStop_m;
  const double in_m = delta.knob_min_z_m - delta.center_m[2] - kBeyondStop_m;
  script.homing = {.out_D = kStart_D + Vector3d(out_m, 0.0, 0.0),
                   .in_D = kStart_D + Vector3d(in_m, 0.0, 0.0)};
  return script;
}

bool any(const std::array<std::int32_t, 3>& commands) {
  return commands[0] != 0 || commands[1] != 0 || commands[2] != 0;
}

}  // namespace

EmulatedFalcon::EmulatedFalcon(const DeviceOptions& options, rt::TimePoint start)
    : name_(options.profile.name),
      torque_gain_per_Nm_(options.profile.falcon.torque_gain_per_Nm),
      usb_(options.profile.usb),
      firmware_(options.profile, *this, options.operator_script.seed, options.firmware_loaded,
                options.operator_script.calibrated),
      delta_(options.profile, options.hand_profile(), kStart_D, options.hand_carries_weight),
      script_(script_options(options), kStart_D),
      hands_(hands_of(options.profile)),
      hand_(options.hand),
      now_(start) {
  delta_.attach_tip_mass(options.tip_mass_kg);
}

ControlReply EmulatedFalcon::control(const SetupPacket& setup,
                                     std::span<const std::uint8_t> /*data*/, rt::TimePoint now) {
  advance_to(now);
  return usb_.control(setup, bridge_, *this, now);
}

void EmulatedFalcon::run(rt::TimePoint now, UsbHost& host) {
  advance_to(now);
  while (const auto packet = host.out_packet(Ft232rUsb::kEndpointOut)) {
    if (!bridge_.offer_out(*packet, now)) {
      break;
    }
    host.take_out(Ft232rUsb::kEndpointOut);
  }
  for (;;) {
    const bool asked = host.wants_in(Ft232rUsb::kEndpointIn);
    bridge_.set_asked(asked, now);
    const auto packet = asked ? bridge_.in_packet(now) : std::nullopt;
    if (!packet || !host.give_in(Ft232rUsb::kEndpointIn, packet->data())) {
      return;
    }
    bridge_.in_taken(now);
  }
}

void EmulatedFalcon::advance_to(rt::TimePoint now) noexcept {
  bridge_.advance_to(now, *this);
  advance_physics(now);
}

void EmulatedFalcon::advance_physics(rt::TimePoint now) noexcept {
  if (now - now_ > kLongestStep) {
    physics_skipped_s_ += rt::seconds(now - now_ - kLongestStep);
    now_ = now - kLongestStep;
    firmware_.check_watchdog(now_);
  }
  while (now_ < now) {
    rt::TimePoint end = std::min(now, now_ + kPhysicsChunk);
    if (const auto deadline = firmware_.watchdog_deadline(); deadline && *deadline > now_) {
      end = std::min(end, *deadline);
    }
    const auto packet = firmware_.last_packet();
    const auto action = script_.update(end, {.host_present = packet && end - *packet < kHostGone,
                                             .counters_loaded = 0,
                                             .homed = firmware_.all_homed(),
                                             .pointer_D = pointer_D_});
    if (action.let_go) {
      delta_.release_hand();
    }
    delta_.advance(rt::seconds(end - now_), torque_Nm(), action.target_D);
    now_ = end;
    if (any(firmware_.commands())) {
      motors_last_nonzero_ = now_;
    }
    firmware_.turn(rt::to_array(delta_.joint_angle_rad()));
    firmware_.check_watchdog(now_);
    if (button_until_ && now_ >= *button_until_) {
      button_until_.reset();
      firmware_.set_buttons(0);
    }
  }
}

Vector3d EmulatedFalcon::torque_Nm() const noexcept {
  const auto& commands = firmware_.commands();
  // Subtracted from 0, so that a zero command gives a torque of 0 rather than of -0.
  return (Vector3d::Zero() - Vector3d(commands[0], commands[1], commands[2])) / torque_gain_per_Nm_;
}

void EmulatedFalcon::hold_with(HandKind hand) noexcept {
  if (hand_ == HandKind::kNone && hand != HandKind::kNone) {
    delta_.place_hand_target(delta_.position_D());
    script_.take_at(delta_.position_D());
  }
  delta_.change_hand(hands_[static_cast<std::size_t>(hand)]);
  hand_ = hand;
}

void EmulatedFalcon::bus_reset(rt::TimePoint now) noexcept {
  usb_.bus_reset();
  bridge_.reset(*this, now);
  bridge_.set_bit_mode(0);
  bridge_.set_latency_ms(Ft232r::kDefaultLatency_ms);
  bridge_.set_asked(false, now);
}

void EmulatedFalcon::power_cycle(rt::TimePoint now) noexcept {
  bus_reset(now);
  firmware_.power_up();
}

bool EmulatedFalcon::motors_on() const { return any(firmware_.commands()); }

void EmulatedFalcon::press_calibration_button() noexcept {
  firmware_.set_buttons(kCentreButton);
  button_until_ = now_ + kButtonPress;
}

void EmulatedFalcon::receive(std::uint8_t character, const LineSettings& line,
                             rt::TimePoint time) noexcept {
  const std::uint64_t answered = firmware_.statistics().packets_answered;
  firmware_.receive(character, line, time);
  if (firmware_.statistics().packets_answered == answered) {
    return;
  }
  const auto counts = firmware_.counters(rt::to_array(delta_.joint_angle_rad()));
  samples_.add(time, {counts[0], counts[1], counts[2], 0, 0, 0});
  for (std::size_t i = 0; i < 3; ++i) {
    max_abs_command_[i] = std::max(max_abs_command_[i], std::abs(firmware_.commands()[i]));
  }
}

void EmulatedFalcon::modem_lines_changed(const LineSettings& line, rt::TimePoint time) noexcept {
  firmware_.modem_lines_changed(line, time);
}

std::array<double, 3> EmulatedFalcon::joint_angle_rad(rt::TimePoint time) noexcept {
  advance_physics(time);
  return rt::to_array(delta_.joint_angle_rad());
}

void EmulatedFalcon::send(std::span<const std::uint8_t> characters, double baud_Hz,
                          rt::TimePoint start) noexcept {
  bridge_.send_from_peer(characters, baud_Hz, start);
}

EmulatorReport EmulatedFalcon::report() const {
  EmulatorReport report;
  report.device = name_;
  report.hand = to_string(hand_);
  report.final_torque_Nm = rt::to_array(torque_Nm());
  report.tip_position_m = rt::to_array(delta_.position_D());
  report.motor_energy_delivered_J = delta_.work().motor_positive_J;
  report.motor_energy_absorbed_J = delta_.work().motor_negative_J;
  if (any(firmware_.commands())) {
    report.seconds_since_motors_nonzero = 0.0;
  } else if (motors_last_nonzero_) {
    report.seconds_since_motors_nonzero = rt::seconds(now_ - *motors_last_nonzero_);
  }
  const FalconFirmware::Statistics& statistics = firmware_.statistics();
  report.watchdog_trips = statistics.watchdog_trips;
  report.reports_sent = statistics.packets_answered;
  report.reports_received = statistics.packets_answered;
  report.physics_skipped_s = physics_skipped_s_;
  const auto counts = firmware_.counters(rt::to_array(delta_.joint_angle_rad()));
  std::copy(counts.begin(), counts.end(), report.counters.begin());
  report.configured = usb_.configured();

  FalconReport& falcon = report.falcon.emplace();
  falcon.firmware_state = FalconFirmware::name_of(firmware_.state());
  falcon.final_command = firmware_.commands();
  falcon.max_abs_command = max_abs_command_;
  for (std::size_t i = 0; i < 3; ++i) {
    falcon.max_abs_torque_Nm[i] = max_abs_command_[i] / torque_gain_per_Nm_;
  }
  falcon.saturated_commands = statistics.saturated_commands;
  falcon.malformed_packets = statistics.malformed_packets;
  falcon.serial_overruns = bridge_.statistics().overruns;
  falcon.serial_framing_errors = bridge_.statistics().framing_errors;
  falcon.boot_handshakes = statistics.handshakes;
  falcon.firmware_bytes_loaded = statistics.bytes_loaded;
  falcon.firmware_wrong_keys = statistics.wrong_keys;
  falcon.firmware_starts = statistics.firmware_starts;
  falcon.homed = firmware_.homed();
  falcon.lights = firmware_.lights();
  falcon.blocked_substeps = delta_.blocked_substeps();
  return report;
}

}  // namespace forcegrid::emulator
