// SPDX-License-Identifier: Apache-2.0
#include "driver/kinematics_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "driver/delta_kinematics.h"
#include "driver/device.h"
#include "driver/falcon_codec.h"
#include "driver/kinematics.h"
#include "rt/vectors.h"

namespace forcegrid::driver {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const Eigen::Vector3d& vector) {
  // Adding zero turns -0.0 into 0.0.
  return Json::array({vector[0] + 0.0, vector[1] + 0.0, vector[2] + 0.0});
}

std::string text_of(const std::array<double, 3>& values) { return Json(values).dump(); }

void require_finite(const std::array<double, 3>& values, const char* what) {
  for (const double value : values) {
    if (!std::isfinite(value)) {
      throw DeviceError(std::string(what) + ": not finite; give three finite numbers");
    }
  }
}

[[noreturn]] void refuse_singular(const profiles::DeviceProfile& profile, const std::string& what) {
  throw DeviceError(what + ": singular for profile '" + profile.name +
                    "' (links folded or stretched, elbow flipped, or tip on the base axis); give a "
                    "pose with the elbow out, for instance near the calibration pose");
}

Json describe(const profiles::DeviceProfile& profile, const ArmKinematics& kinematics,
              const ArmPose& pose, const std::array<double, 3>& force_N) {
  const Eigen::Vector3d torque_Nm = ArmKinematics::joint_torque(pose, rt::to_vector(force_N));
  const Eigen::Vector3d current_A = kinematics.motor_current_A(torque_Nm);
  const ReportCurrent report = kinematics.report_current(current_A);
  Json json;
  json["profile"] = profile.name;
  json["frame"] = "device";
  json["status"] = to_string(pose.status);
  json["position_m"] = json_of(pose.position_D);
  json["joint_angles_rad"] = json_of(pose.joint_angle_rad);
  json["jacobian_m_per_rad"] =
      Json::array({json_of(pose.jacobian_D.row(0)), json_of(pose.jacobian_D.row(1)),
                   json_of(pose.jacobian_D.row(2))});
  json["force_N"] = json_of(rt::to_vector(force_N));
  json["joint_torque_Nm"] = json_of(torque_Nm);
  json["current_A"] = json_of(current_A);
  json["report_mA"] = report.current_mA;
  json["report_clamped"] = report.clamped;
  return json;
}

[[noreturn]] void refuse_unreachable_counts(const profiles::DeviceProfile& profile,
                                            const std::array<double, 3>& counts) {
  throw DeviceError("counts " + text_of(counts) + ": no pose of profile '" + profile.name +
                    "' has them; give counts of legs 1, 2 and 3 that belong together, for "
                    "instance near 0,0,0");
}

[[noreturn]] void refuse_singular_delta(const profiles::DeviceProfile& profile,
                                        const std::string& what) {
  throw DeviceError(what + ": singular for profile '" + profile.name +
                    "' (arm and shin of a leg in one line, or the legs do not hold the platform); "
                    "give a pose nearer to the middle of the workspace");
}

Json describe_delta(const profiles::DeviceProfile& profile, const DeltaPose& pose,
                    const std::array<double, 3>& force_N) {
  const Eigen::Vector3d torque_Nm = DeltaKinematics::joint_torque(pose, rt::to_vector(force_N));
  const falcon::Commands commands = falcon::commands_for_torque(
      rt::to_array(torque_Nm), profile.falcon.torque_gain_per_Nm, profile.falcon.command_limit);
  Json json;
  json["profile"] = profile.name;
  json["frame"] = "base";
  json["status"] = to_string(pose.status);
  json["position_m"] = json_of(pose.position_B);
  json["joint_angles_rad"] = json_of(pose.joint_angle_rad);
  json["jacobian_m_per_rad"] =
      Json::array({json_of(pose.jacobian_B.row(0)), json_of(pose.jacobian_B.row(1)),
                   json_of(pose.jacobian_B.row(2))});
  json["force_N"] = json_of(rt::to_vector(force_N));
  json["joint_torque_Nm"] = json_of(torque_Nm);
  json["command"] = commands.command;
  json["command_scaled"] = commands.scaled;
  return json;
}

std::string delta_json_from_counts(const profiles::DeviceProfile& profile,
                                   const std::array<double, 3>& counts,
                                   const std::array<double, 3>& force_N) {
  const DeltaKinematics kinematics(profile.delta);
  const DeltaPose pose = kinematics.forward(kinematics.angles_of_counts(rt::to_vector(counts)));
  if (pose.status == KinematicsStatus::kSingular) {
    refuse_singular_delta(profile, "counts " + text_of(counts));
  }
  if (pose.status != KinematicsStatus::kOk && pose.status != KinematicsStatus::kOutOfRange) {
    refuse_unreachable_counts(profile, counts);
  }
  return describe_delta(profile, pose, force_N).dump(2);
}

std::string delta_json_from_position(const profiles::DeviceProfile& profile,
                                     const std::array<double, 3>& position_m,
                                     const std::array<double, 3>& force_N) {
  const DeltaKinematics kinematics(profile.delta);
  const DeltaInverse inverse = kinematics.inverse(rt::to_vector(position_m));
  const std::string what = "position " + text_of(position_m) + " m";
  if (inverse.status == KinematicsStatus::kSingular) {
    refuse_singular_delta(profile, what);
  }
  if (inverse.status == KinematicsStatus::kUnreachable) {
    throw DeviceError(what + ": out of reach of profile '" + profile.name +
                      "'; give a position in metres in the base frame, for instance " +
                      text_of(profile.delta.center_m));
  }
  const DeltaPose pose = kinematics.forward(inverse.joint_angle_rad, rt::to_vector(position_m));
  if (pose.status != KinematicsStatus::kOk && pose.status != KinematicsStatus::kOutOfRange) {
    refuse_singular_delta(profile, what);
  }
  Json json = describe_delta(profile, pose, force_N);
  json["counts"] = json_of(inverse.counts);
  return json.dump(2);
}

}  // namespace

std::string kinematics_json_from_counts(const profiles::DeviceProfile& profile,
                                        const std::array<double, 3>& counts,
                                        const std::array<double, 3>& force_N) {
  require_finite(counts, "counts");
  require_finite(force_N, "force");
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return delta_json_from_counts(profile, counts, force_N);
  }
  const ArmKinematics kinematics(profile);
  const ArmPose pose = kinematics.forward(rt::to_vector(counts));
  if (pose.status == KinematicsStatus::kSingular) {
    refuse_singular(profile, "counts " + text_of(counts));
  }
  if (pose.status == KinematicsStatus::kNotFinite) {
    throw DeviceError("counts " + text_of(counts) + ": too large; give counts of a few turns");
  }
  return describe(profile, kinematics, pose, force_N).dump(2);
}

std::string kinematics_json_from_position(const profiles::DeviceProfile& profile,
                                          const std::array<double, 3>& position_m,
                                          const std::array<double, 3>& force_N) {
  require_finite(position_m, "position");
  require_finite(force_N, "force");
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return delta_json_from_position(profile, position_m, force_N);
  }
  const ArmKinematics kinematics(profile);
  const ArmInverse inverse = kinematics.inverse(rt::to_vector(position_m));
  if (inverse.status == KinematicsStatus::kUnreachable) {
    const auto& limits = profile.limits;
    throw DeviceError("position " + text_of(position_m) + " m: out of reach of profile '" +
                      profile.name + "'; give a position in metres, for instance within " +
                      text_of(limits.workspace_min_m) + " to " + text_of(limits.workspace_max_m));
  }
  if (inverse.status == KinematicsStatus::kSingular) {
    refuse_singular(profile, "position " + text_of(position_m) + " m");
  }
  const ArmPose pose = kinematics.forward_from_angles(inverse.joint_angle_rad);
  Json json = describe(profile, kinematics, pose, force_N);
  json["counts"] = json_of(inverse.counts);
  return json.dump(2);
}

}  // namespace forcegrid::driver
