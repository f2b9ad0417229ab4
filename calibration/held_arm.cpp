// SPDX-License-Identifier: Apache-2.0
#include "calibration/held_arm.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "calibration/joint_names.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

constexpr double kIntegralRate_per_s = 4.0;  // of the stiffness
constexpr double kSpeedFilter_s = 0.006;
constexpr double kFastestPlanned_rad_per_s = 1.5;
constexpr double kMoveSpeedPart = 0.5;  // of the planned speed, on average in a minimum-jerk move
constexpr double kMinimumJerkPeak = 1.875;
constexpr double kShortestMove_s = 0.5;
constexpr double kWeakFor_s = 1.0;
constexpr double kCoolNoLonger_s = 90.0;

std::string text(const char* format, double a, double b = 0.0) {
  char buffer[160];
  std::snprintf(buffer, sizeof buffer, format, a, b);
  return buffer;
}

}  // namespace

HeldArm::HeldArm(Rig& rig, const profiles::DeviceProfile& profile, RigidBody& body)
    : rig_(rig),
      profile_(profile),
      body_(body),
      units_(profile),
      warmth_(profile),
      limit_Nm_(units_.half_of_limits_Nm()),
      period_s_(rt::seconds(rig.period())) {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    joint_min_rad_.setConstant(profile.delta.joint_min_rad);
    joint_max_rad_.setConstant(profile.delta.joint_max_rad);
  } else {
    joint_min_rad_ = Vector3d(profile.kinematics.joint_min_rad.data());
    joint_max_rad_ = Vector3d(profile.kinematics.joint_max_rad.data());
  }
  take(rig_.step({}));
  forget_target();
}

void HeldArm::forget_target() noexcept {
  pose_ = body_.pose(counts_);
  target_rad_ = pose_.joint_angle_rad;
  integral_Nm_.setZero();
  speed_.setZero();
}

void HeldArm::take(const driver::DeviceReport& report) {
  const double now_s = rt::seconds(report.released.time_since_epoch());
  if (!has_time_) {
    start_s_ = now_s;
  }
  const double elapsed_s = now_s - start_s_ - time_s_;
  time_s_ = now_s - start_s_;
  counts_ = report.counts;
  const Vector3d last_rad = pose_.joint_angle_rad;
  pose_ = body_.pose(counts_);
  if (!pose_.position_D.allFinite() || pose_.status == driver::KinematicsStatus::kUnreachable ||
      pose_.status == driver::KinematicsStatus::kNotFinite) {
    give_up("the counters belong to no pose of the device; home it again");
  }
  if (has_time_ && elapsed_s > 0.0) {
    const Vector3d rate = (pose_.joint_angle_rad - last_rad) / elapsed_s;
    speed_ += elapsed_s / (elapsed_s + kSpeedFilter_s) * (rate - speed_);
  }
  has_time_ = true;
}

void HeldArm::give_up(const std::string& why) {
  trace_ = nullptr;
  static_cast<void>(rig_.step({}));
  throw CalibrationError(why + "; the motors have no current");
}

void HeldArm::release() { take(rig_.step({})); }

void HeldArm::step(const JointTarget& target, std::optional<Press> press) {
  const Vector3d inertia = body_.joint_inertia_kg_m2(pose_);
  const Vector3d error_rad = target.angle_rad - pose_.joint_angle_rad;
  const Vector3d stiffness = kBandwidth_rad_per_s * kBandwidth_rad_per_s * inertia;
  Vector3d torque_Nm =
      body_.holding_Nm(pose_) + integral_Nm_ +
      inertia.cwiseProduct(target.acceleration_rad_per_s2) + stiffness.cwiseProduct(error_rad) +
      2.0 * kBandwidth_rad_per_s * inertia.cwiseProduct(target.speed_rad_per_s - speed_);
  if (press) {
    torque_Nm[press->joint] = body_.holding_Nm(pose_)[press->joint] + press->torque_Nm;
  }
  const MotorUnits::Command command = units_.nearest(torque_Nm, limit_Nm_);
  const bool limited =
      ((torque_Nm - command.joint_torque_Nm).array().abs() > 0.05 * limit_Nm_.array()).any();
  if (!limited) {
    integral_Nm_ += period_s_ * kIntegralRate_per_s * stiffness.cwiseProduct(error_rad);
    if (press) {
      integral_Nm_[press->joint] = 0.0;
    }
  }
  target_rad_ = target.angle_rad;
  const Vector3d current_A = units_.current_A(command.joint_torque_Nm);
  warmth_.advance(period_s_, {current_A[0], current_A[1], current_A[2]});
  most_A_ = most_A_.cwiseMax(current_A.cwiseAbs());
  take(rig_.step(command.motors));
  if (trace_ != nullptr) {
    trace_->push_back({time_s_, counts_, command.joint_torque_Nm});
  }
  supervise(target, limited, press);
}

void HeldArm::supervise(const JointTarget& target, bool limited, std::optional<Press> press) {
  const double tip_m_per_s = (pose_.jacobian_D * speed_).norm();
  fastest_m_per_s_ = std::max(fastest_m_per_s_, tip_m_per_s);
  if (tip_m_per_s > kSpeedLimit * profile_.limits.max_speed_m_per_s) {
    give_up(
        text("the tip moved at %.2f m/s where %.2f m/s are allowed: let go of it, and look for "
             "what pushes it; if nothing does, a motor or encoder counts the wrong way",
             tip_m_per_s, kSpeedLimit * profile_.limits.max_speed_m_per_s));
  }
  bool away = false;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    const double angle_rad = pose_.joint_angle_rad[joint];
    if (angle_rad > joint_max_rad_[joint] + kBeyondStop_rad ||
        angle_rad < joint_min_rad_[joint] - kBeyondStop_rad) {
      give_up("joint " + joint_name(profile_, static_cast<int>(joint)) +
              text(" is at %.2f rad, far beyond its hard stop: it was not homed in the pose asked "
                   "for, or it counts the wrong way",
                   angle_rad));
    }
    away = away || (std::abs(target.angle_rad[joint] - angle_rad) > kAway_rad &&
                    !(press && press->joint == joint));
  }
  away_since_s_ = !away ? -1.0 : away_since_s_ < 0.0 ? time_s_ : away_since_s_;
  weak_since_s_ = !limited ? -1.0 : weak_since_s_ < 0.0 ? time_s_ : weak_since_s_;
  if (away && time_s_ - away_since_s_ > kAwayFor_s) {
    give_up("the arm does not go where it is moved: let go of it, and clear its way");
  }
  if (limited && time_s_ - weak_since_s_ > kWeakFor_s) {
    give_up(
        "half of what the motors may give does not move the arm: fasten a lighter mass, or let "
        "go of the arm");
  }
  if (warmth_.warmest() > kTooWarm) {
    give_up(
        text("the motors are too warm (%.0f %% of what their continuous current makes them): "
             "let them rest for a minute, and fasten a lighter mass",
             100.0 * warmth_.warmest()));
  }
}

Vector3d HeldArm::planned_speed_rad_per_s() const noexcept {
  const double tip_m_per_s = kPlannedSpeed * profile_.limits.max_speed_m_per_s;
  Vector3d speed_rad_per_s;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    speed_rad_per_s[joint] =
        std::min(kFastestPlanned_rad_per_s,
                 tip_m_per_s / std::max(1e-3, pose_.jacobian_D.col(joint).norm()));
  }
  return speed_rad_per_s;
}

void HeldArm::hold(double time_s) {
  const double end_s = time_s_ + time_s;
  const JointTarget target{.angle_rad = target_rad_};
  while (time_s_ < end_s) {
    step(target);
  }
}

void HeldArm::move_to(const Vector3d& angle_rad) {
  const Vector3d from_rad = target_rad_;
  const Vector3d way_rad = angle_rad - from_rad;
  const double duration_s = move_s(way_rad);
  const double begin_s = time_s_;
  for (double part = 0.0; part < 1.0;) {
    part = std::min(1.0, (time_s_ + period_s_ - begin_s) / duration_s);
    const double square = part * part;
    step({.angle_rad = from_rad + way_rad * square * part * (10.0 - 15.0 * part + 6.0 * square),
          .speed_rad_per_s = way_rad / duration_s * 30.0 * square * (1.0 - part) * (1.0 - part),
          .acceleration_rad_per_s2 = way_rad / (duration_s * duration_s) * 60.0 * part *
                                     (1.0 - part) * (1.0 - 2.0 * part)});
  }
}

double HeldArm::move_s(const Vector3d& way_rad) const noexcept {
  return std::max(kShortestMove_s,
                  kMinimumJerkPeak / kMoveSpeedPart *
                      (way_rad.cwiseQuotient(planned_speed_rad_per_s())).cwiseAbs().maxCoeff());
}

void HeldArm::cool(const Vector3d& angle_rad) {
  if (!warm()) {
    return;
  }
  move_to(angle_rad);
  const double begin_s = time_s_;
  while (warmth_.warmest() > kCool) {
    hold(0.1);
    if (time_s_ - begin_s > kCoolNoLonger_s) {
      give_up("holding the arm alone keeps its motors warm: fasten a lighter mass");
    }
  }
}

}  // namespace forcegrid::calibration
