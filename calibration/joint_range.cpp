// SPDX-License-Identifier: Apache-2.0
#include "calibration/joint_range.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "calibration/joint_names.h"
#include "driver/kinematics.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

constexpr double kNear_rad = 0.2;  // of the expected stop: slower from here
constexpr double kFastSeek_rad_per_s = 0.5;
constexpr double kSlowSeek_rad_per_s = 0.15;
constexpr double kTouched_rad = 0.04;  // the joint is this far behind its target
constexpr double kBeyond_rad = 0.3;
constexpr double kElbowMargin_rad = 0.12;
constexpr double kSettle_s = 0.4;
constexpr double kLook_s = 0.15;
constexpr int kRest_counts = 1;
constexpr double kRestsWithin_s = 6.0;
constexpr double kFrictions = 2.5;
constexpr double kPartOfWeight = 0.35;  // a torque constant that is 25 % wrong still presses
constexpr double kMostOfLimit = 0.9;
constexpr double kWeighs = 0.02;  // of the torque: less weight can't be measured
constexpr std::array<double, 7> kPresses = {1.0, 1.33, 1.67, 2.0, 1.83, 1.5, 1.17};
constexpr std::size_t kHardest = 3;

// One torque against one stop.
struct Pressed {
  double angle_rad = 0.0;
  double torque_Nm = 0.0;
  double holding_Nm = 0.0;
};

using Stop = StopPresses::Stop;
using Averages = std::array<std::vector<Pressed>, 2>;  // of the lower and the upper stop

// Where the other joints wait while this one is near `angle_rad`.
Vector3d park(const profiles::DeviceProfile& profile, const Vector3d& center_rad, int joint,
              double angle_rad) {
  Vector3d parked_rad = center_rad;
  if (joint == 0) {
    return parked_rad;
  }
  const auto& kinematics = profile.kinematics;
  const auto moving = static_cast<std::size_t>(joint);
  const std::size_t other = 3 - moving;
  const double theta_rad =
      kinematics.linkage_offset_rad[moving] + kinematics.linkage_sign[moving] * angle_rad;
  const double now_rad = kinematics.linkage_offset_rad[other] +
                         kinematics.linkage_sign[other] * center_rad[static_cast<int>(other)];
  const double least_rad = kinematics.elbow_min_rad + kElbowMargin_rad - theta_rad;
  const double most_rad = kinematics.elbow_max_rad - kElbowMargin_rad - theta_rad;
  const double parked = std::clamp(now_rad, least_rad, std::max(least_rad, most_rad));
  parked_rad[static_cast<int>(other)] =
      (parked - kinematics.linkage_offset_rad[other]) / kinematics.linkage_sign[other];
  return parked_rad;
}

// Moves outward until the joint does not follow.
void seek(HeldArm& arm, const profiles::DeviceProfile& profile, const Vector3d& parked_rad,
          int joint, const Stop& stop) {
  JointTarget target{.angle_rad = parked_rad};
  const double end_rad = stop.profile_rad + stop.outward * kBeyond_rad;
  while (stop.outward * (end_rad - target.angle_rad[joint]) > 0.0) {
    const bool near = stop.outward * (stop.profile_rad - target.angle_rad[joint]) < kNear_rad;
    const double speed = stop.outward * (near ? kSlowSeek_rad_per_s : kFastSeek_rad_per_s);
    target.angle_rad[joint] += speed * arm.period_s();
    target.speed_rad_per_s[joint] = speed;
    arm.step(target);
    if (stop.outward * (target.angle_rad[joint] - arm.pose().joint_angle_rad[joint]) >
        kTouched_rad) {
      return;
    }
  }
  arm.release();
  throw CalibrationError("joint " + joint_name(profile, joint) +
                         ": no hard stop where the profile has one: it was not homed in the pose "
                         "asked for, or kinematics.encoder_sign is wrong; the motors have no "
                         "current");
}

// Presses until the joint rests, at least kSettle_s, and then records for kLook_s.
Trace press_once(HeldArm& arm, const Vector3d& parked_rad, const Press& pressing) {
  JointTarget target{.angle_rad = parked_rad};
  const auto joint = static_cast<std::size_t>(pressing.joint);
  const auto press_for = [&](double time_s) {
    const double end_s = arm.time_s() + time_s;
    while (arm.time_s() < end_s) {
      target.angle_rad[pressing.joint] = arm.pose().joint_angle_rad[pressing.joint];
      arm.step(target, pressing);
    }
  };
  const double begin_s = arm.time_s();
  press_for(kSettle_s);
  for (;;) {
    const std::int32_t before = arm.counts()[joint];
    press_for(kLook_s);
    if (std::abs(arm.counts()[joint] - before) <= kRest_counts) {
      break;
    }
    if (arm.time_s() - begin_s > kRestsWithin_s) {
      arm.release();
      throw CalibrationError(
          "a joint that is pressed against its stop does not come to rest: let "
          "go of the arm; the motors have no current");
    }
  }
  Trace trace;
  trace.reserve(static_cast<std::size_t>(2.0 * kLook_s / arm.period_s()) + 1);
  arm.record(&trace);
  press_for(kLook_s);
  arm.record(nullptr);
  return trace;
}

// Against a stop that the joint touches; a pause brings it back there.
void press(HeldArm& arm, const profiles::DeviceProfile& profile, const Vector3d& center_rad,
           const Vector3d& parked_rad, int joint, Stop& stop, double press_Nm) {
  const auto with = [&](double part) {
    return press_once(arm, parked_rad, {joint, stop.outward * part * press_Nm});
  };
  static_cast<void>(with(kPresses[kHardest]));  // it may not quite be there yet
  for (const double part : kPresses) {
    if (arm.warm()) {
      arm.forget_target();
      arm.move_to(parked_rad);
      arm.cool(center_rad);
      arm.move_to(parked_rad);
      seek(arm, profile, parked_rad, joint, stop);
      static_cast<void>(with(kPresses[kHardest]));
    }
    stop.presses.push_back(with(part));
  }
}

// The means of the traces, with the counters corrected by `body`.
Averages averages(const StopPresses& presses, RigidBody& body) {
  Averages result;
  for (std::size_t side = 0; side < 2; ++side) {
    for (const Trace& trace : presses.stops[side].presses) {
      Pressed mean;
      for (const TracePoint& point : trace) {
        const driver::ArmPose pose = body.pose(point.counts);
        mean.angle_rad += pose.joint_angle_rad[presses.joint];
        mean.torque_Nm += point.joint_torque_Nm[presses.joint];
        mean.holding_Nm += body.holding_Nm(pose)[presses.joint];
      }
      const double count = std::max(1.0, static_cast<double>(trace.size()));
      result[side].push_back(
          {mean.angle_rad / count, mean.torque_Nm / count, mean.holding_Nm / count});
    }
  }
  return result;
}

// Where the joint would be without torque, by one stop alone.
double unpressed_rad(const std::vector<Pressed>& pressed, double slope_rad_per_Nm, double scale) {
  double sum_rad = 0.0;
  for (const Pressed& one : pressed) {
    sum_rad += one.angle_rad - slope_rad_per_Nm * (one.torque_Nm - scale * one.holding_Nm);
  }
  return sum_rad / static_cast<double>(pressed.size());
}

// d(angle)/d(torque) from pressing more and less.
double slope_rad_per_Nm(const Averages& stops) {
  double product = 0.0;
  double square = 0.0;
  for (const std::vector<Pressed>& pressed : stops) {
    double mean_rad = 0.0;
    double mean_Nm = 0.0;
    for (const Pressed& one : pressed) {
      mean_rad += one.angle_rad / static_cast<double>(pressed.size());
      mean_Nm += one.torque_Nm / static_cast<double>(pressed.size());
    }
    for (const Pressed& one : pressed) {
      product += (one.angle_rad - mean_rad) * (one.torque_Nm - mean_Nm);
      square += (one.torque_Nm - mean_Nm) * (one.torque_Nm - mean_Nm);
    }
  }
  return square > 0.0 ? product / square : 0.0;
}

struct Fit {
  double offset_rad = 0.0;
  double error_rad = 0.0;
  double scale = 1.0;
};

Fit fit(const StopPresses& presses, const Averages& stops, std::optional<double> scale) {
  const auto count = static_cast<Eigen::Index>(stops[0].size() + stops[1].size());
  Eigen::MatrixXd regressors(count, 3);
  Eigen::VectorXd away_rad(count);
  bool weighs = false;
  Eigen::Index row = 0;
  for (std::size_t side = 0; side < 2; ++side) {
    for (const Pressed& one : stops[side]) {
      regressors.row(row) << 1.0, one.torque_Nm - scale.value_or(0.0) * one.holding_Nm,
          -one.holding_Nm;
      away_rad[row++] = one.angle_rad - presses.stops[side].profile_rad;
      weighs = weighs || std::abs(one.holding_Nm) > kWeighs * std::abs(one.torque_Nm);
    }
  }
  const bool find_scale = weighs && !scale;
  if (!find_scale) {
    regressors.conservativeResize(Eigen::NoChange, 2);
  }
  const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> factor(regressors);
  const Eigen::VectorXd solution = factor.solve(away_rad);
  const double variance = (away_rad - regressors * solution).squaredNorm() /
                          static_cast<double>(regressors.rows() - regressors.cols());
  return {.offset_rad = solution[0],
          .error_rad = std::sqrt(variance) * factor.pseudoInverse().row(0).norm(),
          .scale = scale        ? *scale
                   : find_scale ? solution[2] / solution[1]
                                : 1.0};
}

}  // namespace

Vector3d stop_pose_rad(const profiles::DeviceProfile& profile, const Vector3d& center_rad,
                       int joint, bool upper) {
  const auto index = static_cast<std::size_t>(joint);
  const double stop_rad =
      upper ? profile.kinematics.joint_max_rad[index] : profile.kinematics.joint_min_rad[index];
  Vector3d angle_rad = park(profile, center_rad, joint, stop_rad);
  angle_rad[joint] = stop_rad;
  return angle_rad;
}

StopPresses press_against_stops(HeldArm& arm, const profiles::DeviceProfile& profile,
                                RigidBody& body, const Vector3d& center_rad, int joint) {
  const auto index = static_cast<std::size_t>(joint);
  StopPresses result{joint, {}};
  result.stops[0] = {profile.kinematics.joint_min_rad[index], -1.0, {}};
  result.stops[1] = {profile.kinematics.joint_max_rad[index], 1.0, {}};
  for (Stop& stop : result.stops) {
    const Vector3d parked_rad = park(profile, center_rad, joint, stop.profile_rad);
    arm.cool(center_rad);
    arm.move_to(parked_rad);
    seek(arm, profile, parked_rad, joint, stop);
    const double holding_Nm = stop.outward * body.holding_Nm(arm.pose())[joint];
    const double limit_Nm = kMostOfLimit * arm.torque_limit_Nm()[joint];
    const double press_Nm =
        std::min(std::max(kFrictions * profile.dynamics.coulomb_friction_Nm[index],
                          kPartOfWeight * std::abs(holding_Nm)),
                 0.5 * std::max(0.0, limit_Nm - holding_Nm));
    press(arm, profile, center_rad, parked_rad, joint, stop, press_Nm);
    arm.forget_target();
    arm.move_to(parked_rad);
    arm.move_to(center_rad);
  }
  return result;
}

double stops_s(const HeldArm& arm, const profiles::DeviceProfile& profile,
               const Vector3d& center_rad, int joint) {
  double time_s = 0.0;
  for (const bool upper : {false, true}) {
    const Vector3d way_rad = stop_pose_rad(profile, center_rad, joint, upper) - center_rad;
    const double far_rad = std::max(0.0, std::abs(way_rad[joint]) - kNear_rad);
    time_s += far_rad / kFastSeek_rad_per_s + kNear_rad / kSlowSeek_rad_per_s +
              static_cast<double>(kPresses.size() + 1) * (kSettle_s + 2.0 * kLook_s) +
              2.0 * arm.move_s(way_rad);
  }
  return time_s;
}

JointRange judge_range(const StopPresses& presses, const profiles::DeviceProfile& profile,
                       RigidBody body, std::optional<double> scale) {
  const double rad_per_count =
      1.0 / driver::ArmKinematics(profile).counts_of_angles(Vector3d::Ones())[presses.joint];
  const auto index = static_cast<std::size_t>(presses.joint);
  body.set_offset_counts({});
  const Averages as_counted = averages(presses, body);
  const Fit first = fit(presses, as_counted, scale);

  // The links' pose decides their weight, so the first result corrects the second.
  std::array<std::int32_t, 3> corrected{};
  const auto found = static_cast<std::int32_t>(std::lround(first.offset_rad / rad_per_count));
  corrected[index] = -found;
  body.set_offset_counts(corrected);
  const Fit second = fit(presses, averages(presses, body), scale);

  JointRange range;
  range.offset_counts = found + second.offset_rad / rad_per_count;
  range.offset_error_counts = second.error_rad / std::abs(rad_per_count);
  const double slope = slope_rad_per_Nm(as_counted);
  range.low_rad = unpressed_rad(as_counted[0], slope, scale.value_or(1.0));
  range.high_rad = unpressed_rad(as_counted[1], slope, scale.value_or(1.0));
  const double low_rad = presses.stops[0].profile_rad;
  const double high_rad = presses.stops[1].profile_rad;
  range.width_error_rad = (range.high_rad - range.low_rad) - (high_rad - low_rad);
  range.mirrored = std::abs(range.low_rad - low_rad) > kStopTolerance_rad &&
                   std::abs(range.low_rad + high_rad) < kStopTolerance_rad &&
                   std::abs(range.high_rad + low_rad) < kStopTolerance_rad;
  return range;
}

}  // namespace forcegrid::calibration
