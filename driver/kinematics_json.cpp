#include "driver/kinematics_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "driver/device.h"
#include "driver/kinematics.h"

namespace forcegrid::driver {
namespace {

using Json = nlohmann::ordered_json;

Eigen::Vector3d vector_of(const std::array<double, 3>& values) {
  return Eigen::Vector3d(values[0], values[1], values[2]);
}

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
  const Eigen::Vector3d torque_Nm = ArmKinematics::joint_torque(pose, vector_of(force_N));
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
  json["force_N"] = json_of(vector_of(force_N));
  json["joint_torque_Nm"] = json_of(torque_Nm);
  json["current_A"] = json_of(current_A);
  json["report_mA"] = report.current_mA;
  json["report_clamped"] = report.clamped;
  return json;
}

}  // namespace

std::string kinematics_json_from_counts(const profiles::DeviceProfile& profile,
                                        const std::array<double, 3>& counts,
                                        const std::array<double, 3>& force_N) {
  require_finite(counts, "counts");
  require_finite(force_N, "force");
  const ArmKinematics kinematics(profile);
  const ArmPose pose = kinematics.forward(vector_of(counts));
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
  const ArmKinematics kinematics(profile);
  const ArmInverse inverse = kinematics.inverse(vector_of(position_m));
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
