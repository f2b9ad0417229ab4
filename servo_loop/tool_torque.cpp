// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/tool_torque.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "rt/rotation.h"

namespace forcegrid::servo {
namespace {

constexpr double kUnitTolerance = 1e-3;

void require(bool usable, const char* name, double value, const char* wanted) {
  if (!usable || !std::isfinite(value)) {
    throw std::invalid_argument(std::string("tool torque: ") + name + " is " +
                                std::to_string(value) + "; give " + wanted);
  }
}

bool is_unit(const Eigen::Quaterniond& q) noexcept {
  return q.coeffs().allFinite() && std::abs(q.norm() - 1.0) <= kUnitTolerance;
}

Eigen::Vector3d shortened(const Eigen::Vector3d& vector, double longest) noexcept {
  const double length = vector.norm();
  return length > longest ? Eigen::Vector3d(longest / length * vector) : vector;
}

}  // namespace

ToolTorque::ToolTorque(const ToolTorqueOptions& options) : options_(options) {
  require(options.max_torque_Nm > 0.0, "max_torque_Nm", options.max_torque_Nm, "more than 0 N m");
  require(options.max_lever_m >= 0.0, "max_lever_m", options.max_lever_m, "0 m or more");
  require(options.max_rotation_rad >= 0.0, "max_rotation_rad", options.max_rotation_rad,
          "0 rad or more");
  require(options.max_shift_m >= 0.0, "max_shift_m", options.max_shift_m, "0 m or more");
}

void ToolTorque::take(const Wrench& wrench) noexcept {
  known_ =
      wrench.position_W.allFinite() && wrench.force_W.allFinite() &&
      wrench.torque_W_Nm.allFinite() && is_unit(wrench.orientation_WT) &&
      (!wrench.has_rotational_stiffness || wrench.rotational_stiffness_W_Nm_per_rad.allFinite()) &&
      (!wrench.has_gradient ||
       (wrench.gradient_W_N.allFinite() && wrench.stiffness_W_N_per_m.allFinite()));
  if (!known_) {
    return;
  }
  wrench_ = wrench;
  const double squared_N2 = wrench.force_W.squaredNorm();
  const Eigen::Vector3d lever_W =
      squared_N2 > 0.0 ? Eigen::Vector3d(wrench.force_W.cross(wrench.torque_W_Nm) / squared_N2)
                       : Eigen::Vector3d::Zero();
  // A force too small to divide by has no axis.
  lever_W_ = lever_W.allFinite() ? shortened(lever_W, options_.max_lever_m)
                                 : Eigen::Vector3d(Eigen::Vector3d::Zero());
  couple_W_Nm_ = wrench.torque_W_Nm - lever_W_.cross(wrench.force_W);
  couple_gradient_W_N_.setZero();
  for (int axis = 0; wrench.has_gradient && axis < 3; ++axis) {
    couple_gradient_W_N_.col(axis) =
        wrench.gradient_W_N.col(axis) -
        lever_W_.cross(Eigen::Vector3d(wrench.stiffness_W_N_per_m.col(axis)));
  }
}

Eigen::Vector3d ToolTorque::torque_W_Nm(const Eigen::Vector3d& position_W,
                                        const Eigen::Quaterniond& orientation_WT,
                                        const Eigen::Vector3d& force_W,
                                        double gain) const noexcept {
  if (!known_ || !position_W.allFinite() || !is_unit(orientation_WT) || !force_W.allFinite() ||
      !std::isfinite(gain)) {
    return Eigen::Vector3d::Zero();
  }
  const double share = std::clamp(gain, 0.0, 1.0);
  Eigen::Vector3d torque_W_Nm;
  if (wrench_.has_rotational_stiffness) {
    const Eigen::Vector3d theta_W_rad = shortened(
        rt::rotation_vector_rad(wrench_.orientation_WT, orientation_WT), options_.max_rotation_rad);
    const Eigen::Vector3d shift_W =
        shortened(position_W - wrench_.position_W, options_.max_shift_m);
    torque_W_Nm = lever_W_.cross(force_W) +
                  share * (couple_W_Nm_ + wrench_.rotational_stiffness_W_Nm_per_rad * theta_W_rad +
                           couple_gradient_W_N_ * shift_W);
  } else {
    const Eigen::Quaterniond turn =
        (orientation_WT * wrench_.orientation_WT.conjugate()).normalized();
    torque_W_Nm = (turn * lever_W_).cross(force_W) + share * (turn * couple_W_Nm_);
  }
  return torque_W_Nm.allFinite() ? shortened(torque_W_Nm, options_.max_torque_Nm)
                                 : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

Eigen::Vector3d ToolTorque::lever_W() const noexcept {
  return known_ ? lever_W_ : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

}  // namespace forcegrid::servo
