// SPDX-License-Identifier: Apache-2.0
#include "calibration/procedure.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "calibration/directions.h"
#include "calibration/held_arm.h"
#include "calibration/joint_names.h"
#include "calibration/profile_changes.h"
#include "calibration/stroke_center.h"
#include "calibration/strokes.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;
using servo::MotorCheck;

constexpr double kPartForWeight = 0.8;   // of the torque that a step may command
constexpr double kPartForHolding = 0.6;  // of the continuous current
constexpr double kSwing_rad = 0.12;
constexpr double kSwing_Hz = 1.5;
constexpr double kHoldStep_s = 0.05;

template <typename... Values>
std::string text(const char* format, Values... values) {
  char buffer[320];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

Check direction_check(const profiles::DeviceProfile& profile, int joint,
                      MotorCheck::Verdict verdict) {
  Check check{"direction of joint " + joint_name(profile, joint), false, ""};
  switch (verdict) {
    case MotorCheck::Verdict::kPassed:
      check.passed = true;
      check.text = "a push moves it the way that the profile says";
      break;
    case MotorCheck::Verdict::kWrongWay:
      check.text =
          "a push moves it the wrong way: swap the two leads of its motor, or those of its encoder";
      break;
    case MotorCheck::Verdict::kNoAnswer:
      check.text =
          "it does not answer its motor: look at the motor's power and leads, its encoder, and "
          "whether it is held fast";
      break;
    case MotorCheck::Verdict::kRunning:
      check.text = "not looked at, since a joint before it failed";
      break;
  }
  return check;
}

Check range_check(const profiles::DeviceProfile& profile, int joint, const JointRange& range) {
  const auto index = static_cast<std::size_t>(joint);
  Check check{"range of joint " + joint_name(profile, joint), false, ""};
  check.text =
      text("stops at %.3f and %.3f rad, profile %.3f and %.3f", range.low_rad, range.high_rad,
           profile.kinematics.joint_min_rad[index], profile.kinematics.joint_max_rad[index]);
  if (range.mirrored) {
    check.text +=
        ": it counts the other way; change kinematics.encoder_sign of this joint in the "
        "profile, and its calibration.pose_counts";
  } else if (std::abs(range.width_error_rad) > kStopTolerance_rad) {
    check.text += text(
        ": the range is %+.3f rad off: kinematics.encoder_counts_per_turn, a "
        "diameter, or the stops of the profile are wrong, or something is in the "
        "way",
        range.width_error_rad);
  } else {
    check.passed = true;
    check.text += text("; the counter is %+.1f counts off (standard error %.2f)",
                       range.offset_counts, range.offset_error_counts);
  }
  return check;
}

Check travel_check(const profiles::DeviceProfile& profile, const KnobTravel& travel) {
  Check check{"range of the knob", false, ""};
  check.text =
      text("it meets the body at z = %.2f and %.2f mm, profile %.2f and %.2f", 1e3 * travel.in_m,
           1e3 * travel.out_m, 1e3 * profile.delta.knob_min_z_m, 1e3 * profile.delta.knob_max_z_m);
  check.passed = std::abs(travel.in_m - profile.delta.knob_min_z_m) <= kTravelTolerance_m &&
                 std::abs(travel.out_m - profile.delta.knob_max_z_m) <= kTravelTolerance_m;
  if (!check.passed) {
    check.text +=
        ": delta.zero_angle_rad or encoder_rad_per_count is wrong, or something is in the way";
  }
  return check;
}

/// Refuses a mass whose weight alone exceeds what the motors withstand continuously.
void require_bearable(const profiles::DeviceProfile& profile, const HeldArm& arm, RigidBody& body,
                      const Vector3d& center) {
  const Vector3d holding_Nm = body.holding_Nm(pose_at(profile, center));
  const Vector3d current_A = MotorUnits(profile).current_A(holding_Nm);
  for (int joint = 0; joint < 3; ++joint) {
    const double allowed_A = profile.motors.continuous_current_A[static_cast<std::size_t>(joint)];
    const bool too_warm =
        !is_delta(profile) && std::abs(current_A[joint]) > kPartForHolding * allowed_A;
    if (too_warm || std::abs(holding_Nm[joint]) > kPartForWeight * arm.torque_limit_Nm()[joint]) {
      throw CalibrationError(
          "joint " + joint_name(profile, joint) +
          text(" needs %.3f Nm to hold the arm with %.3f kg at its tip, more than its motor bears "
               "for long: fasten less",
               std::abs(holding_Nm[joint]), body.known_mass_kg()));
    }
  }
}

class Procedure {
 public:
  Procedure(Rig& rig, const profiles::DeviceProfile& profile, const ProcedureOptions& options)
      : rig_(rig), profile_(profile), options_(options), body_(profile, options.known_mass_kg) {}

  ProcedureResult run() {
    directions();
    if (result_.passed() && options_.person_done) {
      guided_moves();
    }
    if (result_.passed() && (options_.range || options_.identify)) {
      move();
    }
    result_.absolute = options_.known_mass_kg > 0.0;
    if (result_.passed()) {
      result_.changes = profile_changes(profile_, options_.homed, result_);
    }
    return std::move(result_);
  }

 private:
  void say(const std::string& line, std::optional<double> length_s = std::nullopt) const {
    if (options_.say) {
      options_.say(line, length_s);
    }
  }

  void directions() {
    say("Each motor gives its joint a few short pushes.");
    const auto verdicts = check_directions(rig_, profile_, body_);
    for (int joint = 0; joint < 3; ++joint) {
      result_.checks.push_back(
          direction_check(profile_, joint, verdicts[static_cast<std::size_t>(joint)]));
    }
  }

  void guided_moves() {
    for (const GuidedMove& move : guide_moves(
             rig_, body_, [this](const std::string& line) { say(line); }, options_.person_done)) {
      Check check{std::string("moved ") + move.where, move.as_asked(), ""};
      check.text = text("by %.0f, %.0f, %.0f mm toward you, to your right, up",
                        1e3 * move.moved_D.x(), 1e3 * move.moved_D.y(), 1e3 * move.moved_D.z());
      if (!check.passed) {
        check.text +=
            ": it was not moved as asked, or a joint counts the other way: change its "
            "encoder_sign and the counts of its pose, or the order of the axes' plugs";
      }
      result_.checks.push_back(check);
    }
  }

  void move() {
    const Vector3d center = stroke_center_rad(profile_, options_.known_mass_kg);
    HeldArm arm(rig_, profile_, body_);
    require_bearable(profile_, arm, body_, center);
    say(std::string("The motors hold the device now. Let go of it, and keep clear") +
            (options_.person_done ? "; then press Enter." : "."),
        options_.person_done ? std::nullopt : std::optional(options_.let_go_s));
    const double begin_s = arm.time_s();
    while (options_.person_done ? !options_.person_done()
                                : arm.time_s() - begin_s < options_.let_go_s) {
      arm.hold(kHoldStep_s);
    }
    arm.move_to(center);
    if (options_.range && is_delta(profile_)) {
      travel(arm, center);
    } else if (options_.range) {
      ranges(arm, center);
    }
    if (result_.passed() && options_.identify) {
      identify(arm, center);
    }
    result_.largest_tip_speed_m_per_s = arm.largest_tip_speed_m_per_s();
    const Vector3d& most_A = arm.largest_current_A();
    result_.largest_current_A = {most_A[0], most_A[1], most_A[2]};
    arm.release();
  }

  void ranges(HeldArm& arm, const Vector3d& center) {
    std::array<std::int32_t, 3> offset{};
    for (int joint = 0; joint < 3; ++joint) {
      const auto index = static_cast<std::size_t>(joint);
      if (const std::string why = why_not_to_the_stops(arm, center, joint); !why.empty()) {
        result_.checks.push_back({"range of joint " + joint_name(profile_, joint), true, why});
        continue;
      }
      say("Joint " + joint_name(profile_, joint) + " moves to its stops.",
          stops_s(arm, profile_, center, joint));
      presses_[index] = press_against_stops(arm, profile_, body_, center, joint);
      const JointRange range = judge_range(presses_[index], profile_, body_);
      result_.checks.push_back(range_check(profile_, joint, range));
      offset[index] = -static_cast<std::int32_t>(std::lround(range.offset_counts));
      result_.joints[index].range = range;
    }
    if (result_.passed()) {
      body_.set_offset_counts(offset);
      arm.forget_target();
      arm.move_to(center);
    }
  }

  void travel(HeldArm& arm, const Vector3d& center) {
    say("The knob moves in and out, until it meets the body.");
    const KnobTravel travel = measure_travel(arm, profile_, center);
    result_.checks.push_back(travel_check(profile_, travel));
    result_.knob_travel = travel;
  }

  // A joint that its motor can't hold there would fall onto its stop.
  std::string why_not_to_the_stops(const HeldArm& arm, const Vector3d& center, int joint) {
    for (const bool upper : {false, true}) {
      const Vector3d there = stop_pose_rad(profile_, center, joint, upper);
      const Vector3d needed_Nm = body_.holding_Nm(pose_at(profile_, there)).cwiseAbs();
      for (int each = 0; each < 3; ++each) {
        if (needed_Nm[each] > kPartForWeight * arm.torque_limit_Nm()[each]) {
          return text(
              "not measured: at the stop %.2f rad, joint %s would need %.3f Nm of the "
              "%.3f Nm that a calibration allows itself",
              there[joint], joint_name(profile_, each).c_str(), needed_Nm[each],
              arm.torque_limit_Nm()[each]);
        }
      }
    }
    return "";
  }

  void identify(HeldArm& arm, const Vector3d& center) {
    std::array<Trace, 3> traces;
    for (int joint = 0; joint < 3; ++joint) {
      StrokePlan plan;
      plan.amplitude_rad = stroke_amplitude_rad(profile_, center, joint);
      plan.fastest_rad_per_s = arm.planned_speed_rad_per_s()[joint];
      plan.swing_Hz = kSwing_Hz;
      plan.swing_rad =
          std::min(kSwing_rad, plan.fastest_rad_per_s / (2.0 * std::numbers::pi * plan.swing_Hz));
      plan.quick = options_.quick;
      say("Joint " + joint_name(profile_, joint) + " makes its strokes.", strokes_s(plan));
      arm.cool(center);
      arm.move_to(center);
      Trace& trace = traces[static_cast<std::size_t>(joint)];
      arm.record(&trace);
      make_strokes(arm, center, joint, plan);
      arm.record(nullptr);
    }
    std::array<JointFit, 3> fits;
    const double smoothing_s_per_rad = profile_.dynamics.coulomb_smoothing_s_per_rad;
    if (is_delta(profile_)) {
      fits = fit_joints_of_one_scale(traces, body_, smoothing_s_per_rad);
    } else {
      for (int joint = 0; joint < 3; ++joint) {
        const auto index = static_cast<std::size_t>(joint);
        fits[index] = fit_joint(traces[index], body_, smoothing_s_per_rad, joint);
      }
    }
    take(fits);
  }

  void take(const std::array<JointFit, 3>& fits) {
    const bool absolute = options_.known_mass_kg > 0.0;
    for (int joint = 0; joint < 3; ++joint) {
      const auto index = static_cast<std::size_t>(joint);
      const JointFit& fit = fits[index];
      JointResult& one = result_.joints[index];
      one.fit = fit;
      if (one.range && fit.scale.relative_error() < kLargestScaleError) {
        // The fit has shown the effect of weight at the stops.
        one.range = judge_range(presses_[index], profile_, body_, fit.scale.value);
      }
      const double scale = absolute ? fit.scale.value : 1.0;
      one.coulomb_Nm = std::max(0.0, fit.coulomb_Nm.value / scale);
      one.viscous_Nm_s_per_rad = std::max(0.0, fit.viscous_Nm_s_per_rad.value / scale);
      result_.checks.push_back(friction_check(profile_, joint, fit, absolute));
      if (absolute && !is_delta(profile_)) {
        one.torque_constant_Nm_per_A =
            profile_.motors.torque_constant_Nm_per_A[index] / fit.scale.value;
      }
    }
    if (absolute && is_delta(profile_)) {
      result_.torque_gain_per_Nm = profile_.falcon.torque_gain_per_Nm * fits[0].scale.value;
    }
  }

  Rig& rig_;
  const profiles::DeviceProfile& profile_;
  const ProcedureOptions& options_;
  RigidBody body_;
  std::array<StopPresses, 3> presses_;
  ProcedureResult result_;
};

}  // namespace

bool ProcedureResult::passed() const {
  return std::all_of(checks.begin(), checks.end(), [](const Check& check) { return check.passed; });
}

ProcedureResult run_procedure(Rig& rig, const profiles::DeviceProfile& profile,
                              const ProcedureOptions& options) {
  return Procedure(rig, profile, options).run();
}

}  // namespace forcegrid::calibration
