// SPDX-License-Identifier: Apache-2.0
#include "calibration/profile_changes.h"

#include <cmath>
#include <cstdio>

#include "calibration/joint_names.h"

namespace forcegrid::calibration {
namespace {

std::string number(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.5g", value);
  return buffer;
}

// An array of TOML.
template <typename Value>
std::string three(Value value) {
  std::string text = "[";
  for (std::size_t i = 0; i < 3; ++i) {
    text.append(i == 0 ? "" : ", ").append(value(i));
  }
  return text.append("]");
}

}  // namespace

Check friction_check(const profiles::DeviceProfile& profile, int joint, const JointFit& fit,
                     bool absolute) {
  Check check{"friction of joint " + joint_name(profile, joint), false, ""};
  char buffer[320];
  const double scale = absolute ? fit.scale.value : 1.0;
  std::snprintf(
      buffer, sizeof buffer, "Coulomb %.4g Nm (+-%.1f %%), viscous %.4g Nm s/rad (+-%.1f %%)%s",
      fit.coulomb_Nm.value / scale, 100.0 * fit.coulomb_Nm.relative_error(),
      fit.viscous_Nm_s_per_rad.value / scale, 100.0 * fit.viscous_Nm_s_per_rad.relative_error(),
      absolute ? "" : ", by the profile's torque constant");
  check.text = buffer;
  if (absolute) {
    std::snprintf(buffer, sizeof buffer, "; torque constant %.4g of the profile's (+-%.1f %%)",
                  1.0 / fit.scale.value, 100.0 * fit.scale.relative_error());
    check.text += buffer;
  }
  if (absolute && !(fit.scale.value > 0.0)) {
    check.text +=
        ": its weight pulls the wrong way: it counts the other way than the profile says "
        "(kinematics.encoder_sign), or no mass is fastened";
  } else if (absolute && !(fit.scale.relative_error() < kLargestScaleError)) {
    check.text +=
        ": the torque constant is too uncertain: fasten a larger mass, and leave out "
        "--quick";
  } else if (!(fit.coulomb_Nm.relative_error() < kLargestFrictionError) &&
             fit.coulomb_Nm.error >
                 0.02 * profile.dynamics.coulomb_friction_Nm[static_cast<std::size_t>(joint)]) {
    check.text += ": the friction is too uncertain: nobody may touch the device; leave out --quick";
  } else {
    check.passed = true;
  }
  return check;
}

std::vector<ProfileChange> profile_changes(const profiles::DeviceProfile& profile, bool homed,
                                           const ProcedureResult& result) {
  std::vector<ProfileChange> changes;
  const auto& joints = result.joints;
  if (joints[0].fit) {
    changes.emplace_back("dynamics.coulomb_friction_Nm",
                         three([&](std::size_t i) { return number(joints[i].coulomb_Nm); }));
    changes.emplace_back("dynamics.viscous_friction_Nm_s_per_rad", three([&](std::size_t i) {
                           return number(joints[i].viscous_Nm_s_per_rad);
                         }));
  }
  if (joints[0].torque_constant_Nm_per_A) {
    changes.emplace_back("motors.torque_constant_Nm_per_A", three([&](std::size_t i) {
                           return number(*joints[i].torque_constant_Nm_per_A);
                         }));
  }
  if (result.torque_gain_per_Nm) {
    changes.emplace_back("falcon.torque_gain_per_Nm", number(*result.torque_gain_per_Nm));
  }
  const auto counts_off = [&](std::size_t joint) {
    return joint < 3 && joints[joint].range ? std::lround(joints[joint].range->offset_counts) : 0L;
  };
  if (homed && (joints[0].range || joints[1].range || joints[2].range)) {
    std::string counts;
    for (std::size_t i = 0; i < profile.calibration.pose_counts.size(); ++i) {
      counts += (i == 0 ? "[" : ", ") +
                std::to_string(profile.calibration.pose_counts[i] - counts_off(i));
    }
    changes.emplace_back("calibration.pose_counts", counts + "]");
  }
  return changes;
}

}  // namespace forcegrid::calibration
