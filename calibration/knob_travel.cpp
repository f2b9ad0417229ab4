// SPDX-License-Identifier: Apache-2.0
#include "calibration/knob_travel.h"

#include "driver/delta_kinematics.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

constexpr double kSpeed_m_per_s = 0.02;
constexpr double kTouched_m = 0.004;  // the knob is this far behind its target
constexpr double kBeyond_m = 0.012;
constexpr double kRest_s = 0.3;
constexpr double kLookAtKnob_s = 0.1;

// z in B of the pose with this x in D.
double height_B_m(const HeldArm& arm, const profiles::DeviceProfile& profile) {
  return arm.pose().position_D.x() + profile.delta.center_m[2];
}

// Moves the target outward from the middle until the knob stays behind, and records where it is.
double stop_at(HeldArm& arm, const profiles::DeviceProfile& profile, double outward,
               double expected_m) {
  const driver::DeltaKinematics kinematics(profile.delta);
  Vector3d target_B(profile.delta.center_m.data());
  JointTarget target;
  for (;;) {
    target_B.z() += outward * kSpeed_m_per_s * arm.period_s();
    const auto inverse = kinematics.inverse(target_B);
    if (inverse.status == driver::KinematicsStatus::kUnreachable ||
        inverse.status == driver::KinematicsStatus::kNotFinite ||
        outward * (target_B.z() - expected_m) > kBeyond_m) {
      arm.release();
      throw CalibrationError(
          "the knob does not meet the device's body where the profile says: home it again, or "
          "correct delta.zero_angle_rad and encoder_rad_per_count; the motors have no current");
    }
    target.angle_rad = inverse.joint_angle_rad;
    arm.step(target);
    if (outward * (target_B.z() - height_B_m(arm, profile)) > kTouched_m) {
      break;
    }
  }
  const auto step_for = [&](double time_s) {
    double sum_m = 0.0;
    int steps = 0;
    for (const double end_s = arm.time_s() + time_s; arm.time_s() < end_s; ++steps) {
      arm.step(target);
      sum_m += height_B_m(arm, profile);
    }
    return sum_m / steps;
  };
  static_cast<void>(step_for(kRest_s));
  return step_for(kLookAtKnob_s);
}

}  // namespace

KnobTravel measure_travel(HeldArm& arm, const profiles::DeviceProfile& profile,
                          const Vector3d& center_rad) {
  KnobTravel travel;
  travel.in_m = stop_at(arm, profile, -1.0, profile.delta.knob_min_z_m);
  arm.forget_target();
  arm.move_to(center_rad);
  travel.out_m = stop_at(arm, profile, 1.0, profile.delta.knob_max_z_m);
  arm.forget_target();
  arm.move_to(center_rad);
  return travel;
}

}  // namespace forcegrid::calibration
