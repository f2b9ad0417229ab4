// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulated_w2.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "rt/vectors.h"

namespace forcegrid::emulator {

namespace {

using Eigen::Vector3d;

// ESCON set-value range; the margin absorbs rounding of 0.5 +- 0.4.
constexpr double kDutyFullScale = 0.4;
constexpr double kDutyMargin = 1e-9;
constexpr std::int32_t kPowerUpRange_counts = 20000;
constexpr std::uint8_t kInterfaceClassHid = 3;

Vector3d calibration_counts(const profiles::DeviceProfile& profile) {
  const auto& pose = profile.calibration.pose_counts;
  return {static_cast<double>(pose[0]), static_cast<double>(pose[1]), static_cast<double>(pose[2])};
}

W2Firmware::Counters power_up_counters(const DeviceOptions& options) {
  W2Firmware::Counters counters{};
  if (options.operator_script.calibrated) {
    std::copy(options.profile.calibration.pose_counts.begin(),
              options.profile.calibration.pose_counts.end(), counters.begin());
  } else if (options.random_power_up_counters) {
    std::mt19937_64 random(options.operator_script.seed);
    const std::size_t encoders = profiles::has_wrist(options.profile) ? 6 : 3;
    for (std::size_t i = 0; i < encoders; ++i) {
      counters[i] = static_cast<std::int32_t>(random() % (2 * kPowerUpRange_counts + 1)) -
                    kPowerUpRange_counts;
    }
  }
  return counters;
}

}  // namespace

EmulatedW2::EmulatedW2(const DeviceOptions& options, rt::TimePoint start)
    : identity_{.vendor_id = options.profile.usb.vendor_id,
                .product_id = options.profile.usb.product_id,
                .device_release = options.profile.usb.device_release,
                .interface_class = kInterfaceClassHid},
      usb_(options.profile.usb),
      firmware_(options.profile.motors.full_scale_current_A,
                static_cast<std::size_t>(options.profile.usb.report_bytes),
                options.profile.gimbal_motors.present),
      arm_(options.profile, options.hand_profile(),
           ArmKinematics(options.profile.kinematics)
               .joint_angle_rad(calibration_counts(options.profile)),
           options.hand_carries_weight),
      wrist_(options.profile.gimbal),
      script_(OperatorScript::on_device(options.operator_script, options.profile),
              arm_.position_D()),
      hands_(hands_of(options.profile)),
      hand_(options.hand),
      frame_order_(options.frame_order),
      name_(options.profile.name),
      full_scale_current_A_(options.profile.motors.full_scale_current_A),
      torque_per_current_Nm_per_A_(
          rt::to_vector(options.profile.kinematics.encoder_sign)
              .cwiseProduct(rt::to_vector(options.profile.motors.torque_constant_Nm_per_A))
              .cwiseProduct(rt::to_vector(options.profile.kinematics.body_diameter_m))
              .cwiseQuotient(rt::to_vector(options.profile.kinematics.capstan_diameter_m))),
      has_stylus_button_(options.profile.gimbal.stylus_button),
      gimbal_rad_(OperatorScript::on_device({}, options.profile).wrist_rest_rad),
      now_(start),
      counters_are_true_(options.operator_script.calibrated) {
  arm_.attach_tip_mass(options.tip_mass_kg);
  if (const auto& motors = options.profile.gimbal_motors; motors.present) {
    driven_wrist_.emplace(options.profile, gimbal_rad_);
    driven_wrist_->hold(hand_ != HandKind::kNone);
    wrist_torque_per_current_Nm_per_A_ =
        rt::to_vector(options.profile.gimbal.encoder_sign)
            .cwiseProduct(rt::to_vector(motors.torque_constant_Nm_per_A))
            .cwiseProduct(rt::to_vector(motors.ratio));
  }
  identity_.interfaces = usb_.interfaces();
  firmware_.turn_encoders(encoder_positions());
  firmware_.set_counters(power_up_counters(options));
  if (!options.core.empty()) {
    core_ = std::make_unique<CoreLine>(options.core);
    firmware_.hand_over();
  }
}

std::array<std::int64_t, 6> EmulatedW2::encoder_positions() const noexcept {
  const Vector3d arm = arm_.kinematics().counts(arm_.joint_angle_rad());
  const auto wrist = wrist_.encoder_positions(gimbal_rad_);
  return {std::llround(arm[0]),
          std::llround(arm[1]),
          std::llround(arm[2]),
          wrist[0],
          wrist[1],
          wrist[2]};
}

Vector3d EmulatedW2::linkage_angle_rad() const noexcept {
  return arm_.kinematics().motion(arm_.joint_angle_rad(), Vector3d::Zero()).linkage_angle_rad;
}

Eigen::Matrix3d EmulatedW2::tool_axes_D() const noexcept {
  return wrist_.tool_axes_D(linkage_angle_rad(), gimbal_rad_);
}

// Of the motors, and of the moment with which the hand holds the handle of a driven wrist.
Vector3d EmulatedW2::arm_torque_Nm() const noexcept {
  const Vector3d motors_Nm = current_A_.cwiseProduct(torque_per_current_Nm_per_A_);
  return driven_wrist_
             ? Vector3d(motors_Nm + driven_wrist_->arm_torque_Nm(linkage_angle_rad(),
                                                                 arm_.kinematics().linkage_sign()))
             : motors_Nm;
}

void EmulatedW2::turn_wrist(const OperatorScript::Action& action, double duration_s) noexcept {
  if (!wrist_.present()) {
    return;
  }
  const Vector3d wanted_rad = wrist_.within_stops(action.gimbal_rad);
  if (driven_wrist_) {
    driven_wrist_->advance(duration_s,
                           wrist_current_A_.cwiseProduct(wrist_torque_per_current_Nm_per_A_),
                           wanted_rad, linkage_angle_rad());
    gimbal_rad_ = driven_wrist_->angle_rad();
  } else if (hand_ != HandKind::kNone) {
    gimbal_rad_ = wanted_rad;
  }
  const bool down = has_stylus_button_ && action.stylus_pressed && hand_ != HandKind::kNone;
  stylus_clicks_ += down && !stylus_down_ ? 1 : 0;
  stylus_down_ = down;
  firmware_.hold_stylus_button(down);
}

UsbIdentity EmulatedW2::identity() const noexcept { return identity_; }

std::span<const UsbEndpoint> EmulatedW2::endpoints() const noexcept { return usb_.endpoints(); }

void EmulatedW2::advance_to(rt::TimePoint now) noexcept {
  if (now - now_ > kLongestStep) {
    physics_skipped_s_ += rt::seconds(now - now_ - kLongestStep);
    now_ = now - kLongestStep;
    if (firmware_.check_watchdog(now_)) {
      drive_motors();
    }
  }
  while (now_ < now) {
    rt::TimePoint end = std::min(now, now_ + kPhysicsChunk);
    if (const auto deadline = firmware_.watchdog_deadline(); deadline && *deadline > now_) {
      end = std::min(end, *deadline);
    }
    const auto fed = firmware_.last_feed();
    const auto action =
        script_.update(end, {.host_present = usb_.configured() && fed && end - *fed < kHostGone,
                             .counters_loaded = firmware_.statistics().counters_loaded,
                             .pointer_D = pointer_D_});
    if (action.press_button) {
      firmware_.press_calibration_button();
    }
    if (action.let_go) {
      arm_.release_hand();
      if (driven_wrist_) {
        driven_wrist_->hold(false);
      }
    }
    arm_.advance(rt::seconds(end - now_), arm_torque_Nm(), action.target_D);
    turn_wrist(action, rt::seconds(end - now_));
    now_ = end;
    if (motors_on()) {
      motors_last_nonzero_ = now_;
    }
    if (firmware_.check_watchdog(now_)) {
      drive_motors();
    }
  }
  firmware_.turn_encoders(encoder_positions());
  if (core_ && motors_on() && !host_reports(now)) {
    stop_core();
  }
}

// The W2's own watchdog waits half a second, too long for currents that the host does not know.
bool EmulatedW2::host_reports(rt::TimePoint now) const noexcept {
  return firmware_.watchdog_deadline() && now - *firmware_.last_feed() <= kCoreSilence;
}

void EmulatedW2::stop_core() noexcept {
  firmware_.apply({});
  drive_motors();
}

ControlReply EmulatedW2::control(const SetupPacket& setup, std::span<const std::uint8_t> data,
                                 rt::TimePoint now) {
  advance_to(now);
  auto reply = usb_.control(setup, data);
  if (usb_.configured() != firmware_.configured()) {
    firmware_.set_configured(usb_.configured(), now);
  }
  return reply;
}

void EmulatedW2::run(rt::TimePoint now, UsbHost& host) {
  advance_to(now);
  const auto serve_out = [&] {
    const auto packet = host.out_packet(usb_.endpoint_out());
    if (packet && !halted(usb_.endpoint_out()) && firmware_.offer_out(*packet)) {
      host.take_out(usb_.endpoint_out());
    }
  };
  const auto serve_in = [&] {
    if (firmware_.in_armed() && !halted(usb_.endpoint_in()) && host.wants_in(usb_.endpoint_in()) &&
        host.give_in(usb_.endpoint_in(), firmware_.in_report())) {
      firmware_.collect_in();
    }
  };
  if (frame_order_ == FrameOrder::kOutFirst) {
    serve_out();
    run_firmware(now);
    serve_in();
  } else {
    serve_in();
    serve_out();
    run_firmware(now);
  }
}

void EmulatedW2::hold_with(HandKind hand) noexcept {
  if (hand_ == HandKind::kNone && hand != HandKind::kNone) {
    arm_.place_hand_target(arm_.position_D());
    script_.take_at(arm_.position_D());
  }
  arm_.change_hand(hands_[static_cast<std::size_t>(hand)]);
  if (driven_wrist_) {
    driven_wrist_->hold(hand != HandKind::kNone);
  }
  hand_ = hand;
}

void EmulatedW2::bus_reset(rt::TimePoint now) noexcept {
  usb_.bus_reset();
  firmware_.set_configured(false, now);
  if (core_) {
    stop_core();
  }
}

void EmulatedW2::power_cycle(rt::TimePoint now) noexcept {
  advance_to(now);
  usb_.bus_reset();
  firmware_.reboot();
  drive_motors();
}

void EmulatedW2::run_firmware(rt::TimePoint now) noexcept {
  if (firmware_.run(now)) {
    samples_.add(now, firmware_.counters());
  }
  if (firmware_.statistics().reports_applied != reports_applied_) {
    reports_applied_ = firmware_.statistics().reports_applied;
    drive_motors();
  }
  if (core_) {
    run_core(now);
  }
}

void EmulatedW2::run_core(rt::TimePoint now) noexcept {
  if (const auto answer = core_->receive(); answer && answer->number > 0) {
    ++core_use_.answers;
    core_answered_ = now;
    const double latency_ms =
        1e3 * rt::seconds(now - core_sent_[answer->number % core_sent_.size()]);
    core_latency_sum_ms_ += latency_ms;
    core_use_.worst_latency_ms = std::max(core_use_.worst_latency_ms, latency_ms);
    if (host_reports(now)) {
      firmware_.apply(answer->current_mA);
      drive_motors();
    }
  } else if (core_answered_ && now - *core_answered_ > kCoreSilence) {
    core_answered_.reset();
    ++core_use_.silences;
    stop_core();
  }
  const bool true_counters = counters_are_true_ || firmware_.statistics().counters_loaded > 0;
  const std::uint64_t cycles = core_use_.cycles;
  const bool due = cycles == 0 || now - core_sent_[cycles % core_sent_.size()] >= kCorePeriod;
  if (due && true_counters && host_reports(now)) {
    const auto number = static_cast<std::uint32_t>(++core_use_.cycles);
    core_sent_[number % core_sent_.size()] = now;
    core_->send(number, firmware_.counters());
  }
}

double EmulatedW2::current_of(std::size_t motor) noexcept {
  const W2Firmware::Outputs& outputs = firmware_.outputs();
  const double fraction = (outputs.duty[motor] - W2Firmware::kZeroCurrentDuty) / kDutyFullScale;
  if (!outputs.motor_enable) {
    return 0.0;
  }
  if (!(std::abs(fraction) <= 1.0 + kDutyMargin)) {
    ++out_of_range_currents_;
    return 0.0;
  }
  return full_scale_current_A_ * fraction;
}

void EmulatedW2::drive_motors() noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    current_A_[axis] = current_of(i);
    wrist_current_A_[axis] = driven_wrist_ ? current_of(i + 3) : 0.0;
  }
  max_abs_current_A_ = max_abs_current_A_.cwiseMax(current_A_.cwiseAbs());
  max_abs_wrist_current_A_ = max_abs_wrist_current_A_.cwiseMax(wrist_current_A_.cwiseAbs());
}

void EmulatedW2::describe_wrist(EmulatorReport& report) const {
  if (!wrist_.present()) {
    return;
  }
  const Eigen::Matrix3d axes_D = tool_axes_D();
  const Eigen::Quaterniond q(axes_D);
  WristReport wrist;
  wrist.angle_rad = rt::to_array(gimbal_rad_);
  wrist.orientation_wxyz = {q.w(), q.x(), q.y(), q.z()};
  wrist.stylus_clicks = stylus_clicks_;
  if (driven_wrist_) {
    wrist.final_current_mA = rt::to_array(1e3 * wrist_current_A_);
    wrist.max_abs_current_mA = rt::to_array(1e3 * max_abs_wrist_current_A_);
    wrist.final_torque_Nm =
        rt::to_array(wrist_current_A_.cwiseProduct(wrist_torque_per_current_Nm_per_A_));
    wrist.hand_torque_Nm = rt::to_array(driven_wrist_->hand_torque_D());
  }
  report.wrist = wrist;
}

EmulatorReport EmulatedW2::report() const {
  EmulatorReport report;
  report.device = name_;
  report.hand = to_string(hand_);
  const Vector3d torque_Nm = current_A_.cwiseProduct(torque_per_current_Nm_per_A_);
  const Vector3d tip_D = arm_.position_D();
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    report.final_current_mA[i] = 1e3 * current_A_[axis];
    report.max_abs_current_mA[i] = 1e3 * max_abs_current_A_[axis];
    report.final_torque_Nm[i] = torque_Nm[axis];
    report.tip_position_m[i] = tip_D[axis];
  }
  report.motor_energy_delivered_J = arm_.work().motor_positive_J;
  report.motor_energy_absorbed_J = arm_.work().motor_negative_J;
  if (motors_on()) {
    report.seconds_since_motors_nonzero = 0.0;
  } else if (motors_last_nonzero_) {
    report.seconds_since_motors_nonzero = rt::seconds(now_ - *motors_last_nonzero_);
  }
  report.out_of_range_currents = out_of_range_currents_;
  const W2Firmware::Statistics& statistics = firmware_.statistics();
  report.watchdog_trips = statistics.watchdog_trips;
  report.reports_sent = statistics.reports_sent;
  report.reports_received = statistics.reports_received;
  report.short_reports = statistics.short_reports;
  report.long_reports = statistics.long_reports;
  report.reports_drained = statistics.reports_drained;
  report.counters_loaded = statistics.counters_loaded;
  report.physics_skipped_s = physics_skipped_s_;
  describe_wrist(report);
  if (core_) {
    report.core = core_use_;
    report.core->broken_frames = core_->broken_frames();
    report.core->mean_latency_ms =
        core_latency_sum_ms_ / std::max(1.0, static_cast<double>(core_use_.answers));
  }
  report.counters = firmware_.counters();
  report.configured = usb_.configured();
  return report;
}

}  // namespace forcegrid::emulator
