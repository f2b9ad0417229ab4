// SPDX-License-Identifier: Apache-2.0
#include "driver/delta_kinematics.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::driver {
namespace {

// Newton's method squares the error of a step: after one below this only rounding is left.
constexpr double kLastStep_m = 1e-12;
// A step longer than any device: the iteration has lost its way.
constexpr double kLostStep_m = 1.0;
// As for the arm: hard stops give.
constexpr double kStopTolerance_rad = 0.05;

}  // namespace

/// What the driven angles fix.
struct DeltaKinematics::Driven {
  explicit Driven(const Eigen::Vector3d& joint_angle_rad) {
    for (std::size_t leg = 0; leg < 3; ++leg) {
      const double angle_rad = joint_angle_rad[static_cast<Eigen::Index>(leg)];
      cosine[leg] = std::cos(angle_rad);
      sine[leg] = std::sin(angle_rad);
    }
  }
  std::array<double, 3> cosine{};
  std::array<double, 3> sine{};
};

DeltaKinematics::DeltaKinematics(const profiles::DeviceProfile::Delta& geometry)
    : geometry_(geometry),
      end_pieces_m_(geometry.knee_end_m + geometry.platform_end_m),
      offset_u_m_(geometry.platform_offset_u_m - geometry.base_offset_u_m),
      offset_v_m_(geometry.platform_offset_v_m - geometry.base_offset_v_m) {
  for (std::size_t leg = 0; leg < 3; ++leg) {
    cos_azimuth_[leg] = std::cos(geometry.leg_azimuth_rad[leg]);
    sin_azimuth_[leg] = std::sin(geometry.leg_azimuth_rad[leg]);
  }
  double turn = 0.0;
  for (std::size_t leg = 0; leg < 3; ++leg) {
    turn += std::sin(geometry.leg_azimuth_rad[(leg + 1) % 3] - geometry.leg_azimuth_rad[leg]);
  }
  orientation_ = turn < 0.0 ? -1.0 : 1.0;
}

bool DeltaKinematics::within_stops(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return joint_angle_rad.minCoeff() >= geometry_.joint_min_rad - kStopTolerance_rad &&
         joint_angle_rad.maxCoeff() <= geometry_.joint_max_rad + kStopTolerance_rad;
}

Eigen::Vector3d DeltaKinematics::angles_of_counts(const Eigen::Vector3d& counts) const noexcept {
  return (counts.array() * geometry_.encoder_rad_per_count + geometry_.zero_angle_rad).matrix();
}

Eigen::Vector3d DeltaKinematics::counts_of_angles(
    const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return ((joint_angle_rad.array() - geometry_.zero_angle_rad) / geometry_.encoder_rad_per_count)
      .matrix();
}

Eigen::Vector3d DeltaKinematics::sphere_start(
    const Eigen::Vector3d& joint_angle_rad) const noexcept {
  const Driven driven(joint_angle_rad);
  std::array<Eigen::Vector3d, 3> center;
  for (std::size_t leg = 0; leg < 3; ++leg) {
    const double u_m = geometry_.thigh_m * driven.cosine[leg] - offset_u_m_;
    const double v_m = -offset_v_m_;
    center[leg] << cos_azimuth_[leg] * u_m - sin_azimuth_[leg] * v_m,
        sin_azimuth_[leg] * u_m + cos_azimuth_[leg] * v_m, geometry_.thigh_m * driven.sine[leg];
  }
  // From the circumcentre of the knees along their plane's normal.
  const Eigen::Vector3d edge1 = center[1] - center[0];
  const Eigen::Vector3d edge2 = center[2] - center[0];
  const Eigen::Vector3d normal = edge1.cross(edge2);
  const double normal_squared = normal.squaredNorm();
  const Eigen::Vector3d to_circumcenter =
      (edge1.squaredNorm() * edge2.cross(normal) + edge2.squaredNorm() * normal.cross(edge1)) /
      (2.0 * normal_squared);
  const double radius_m = geometry_.shin_m + end_pieces_m_;
  const double height_m =
      std::sqrt(radius_m * radius_m - to_circumcenter.squaredNorm());  // NaN: they do not meet
  const double outward = normal.z() < 0.0 ? -1.0 : 1.0;
  return center[0] + to_circumcenter + outward * height_m / std::sqrt(normal_squared) * normal;
}

/// Steps from pose.position_B.
/// @returns false when it does not converge or ends on another branch; else pose has everything.
bool DeltaKinematics::newton(const Driven& driven, DeltaPose& pose) const noexcept {
  const double shin_squared_m2 = geometry_.shin_m * geometry_.shin_m;
  Eigen::Matrix3d gradient;  // rows dF_i/dp
  Eigen::Vector3d sine_of_knee;
  for (int step = 0; step <= kMaxSteps; ++step) {
    Eigen::Vector3d residual_m;
    for (std::size_t leg = 0; leg < 3; ++leg) {
      const auto row = static_cast<Eigen::Index>(leg);
      const double x_m = pose.position_B.x();
      const double y_m = pose.position_B.y();
      const double u_m = x_m * cos_azimuth_[leg] + y_m * sin_azimuth_[leg] + offset_u_m_;
      const double v_m = -x_m * sin_azimuth_[leg] + y_m * cos_azimuth_[leg] + offset_v_m_;
      const double shin_u_m = u_m - geometry_.thigh_m * driven.cosine[leg];
      const double shin_w_m = pose.position_B.z() - geometry_.thigh_m * driven.sine[leg];
      const double reach_m = std::sqrt(shin_u_m * shin_u_m + shin_w_m * shin_w_m);
      const double in_plane_m = std::sqrt(shin_squared_m2 - v_m * v_m);  // NaN: out of its reach
      residual_m[row] = reach_m - end_pieces_m_ - in_plane_m;
      const double du = shin_u_m / reach_m;  // cos theta_2
      const double dv = v_m / in_plane_m;    // cot theta_3
      const double dw = shin_w_m / reach_m;  // sin theta_2
      gradient.row(row) << du * cos_azimuth_[leg] - dv * sin_azimuth_[leg],
          du * sin_azimuth_[leg] + dv * cos_azimuth_[leg], dw;
      sine_of_knee[row] = dw * driven.cosine[leg] - du * driven.sine[leg];
    }
    const Eigen::Matrix3d inverse = gradient.inverse();
    const Eigen::Vector3d step_B = inverse * residual_m;
    const double largest_m = step_B.cwiseAbs().maxCoeff();
    if (!std::isfinite(step_B.sum()) || largest_m > kLostStep_m) {
      return false;
    }
    pose.position_B -= step_B;
    if (largest_m >= kLastStep_m) {
      continue;
    }
    const double smallest_sine = sine_of_knee.minCoeff();
    const double volume =
        orientation_ * gradient.determinant() /
        (gradient.row(0).norm() * gradient.row(1).norm() * gradient.row(2).norm());
    if (smallest_sine < -kSingularSine || volume < -kSingularVolume) {
      return false;  // an elbow in, or the platform on the inner side of the knees
    }
    if (smallest_sine < kSingularSine || volume < kSingularVolume) {
      pose.status = KinematicsStatus::kSingular;
      pose.jacobian_B.setZero();
    } else {
      // J_v = diag(1 / (a sin(theta_2 - theta_1))) gradient, and J its inverse.
      pose.status = KinematicsStatus::kOk;
      pose.jacobian_B = inverse * (geometry_.thigh_m * sine_of_knee).asDiagonal();
    }
    return true;
  }
  return false;
}

DeltaPose DeltaKinematics::forward(const Eigen::Vector3d& joint_angle_rad,
                                   const Eigen::Vector3d& start_B) const noexcept {
  DeltaPose pose;
  if (!joint_angle_rad.allFinite()) {
    return pose;
  }
  const Driven driven(joint_angle_rad);
  pose.joint_angle_rad = joint_angle_rad;
  pose.position_B = start_B;
  // A singular pose may be one that only an unlucky start leads to.
  bool found = newton(driven, pose) && pose.status == KinematicsStatus::kOk;
  if (!found) {
    pose.position_B = sphere_start(joint_angle_rad);
    found = newton(driven, pose);
  }
  if (!found) {
    return {.status = KinematicsStatus::kUnreachable};
  }
  if (pose.status == KinematicsStatus::kOk && !within_stops(joint_angle_rad)) {
    pose.status = KinematicsStatus::kOutOfRange;
  }
  return pose;
}

DeltaPose DeltaKinematics::forward(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return forward(joint_angle_rad, sphere_start(joint_angle_rad));
}

DeltaInverse DeltaKinematics::inverse(const Eigen::Vector3d& position_B) const noexcept {
  DeltaInverse result;
  if (!position_B.allFinite()) {
    return result;
  }
  result.status = KinematicsStatus::kUnreachable;
  double smallest_sine = 1.0;
  Eigen::Vector3d angle_rad;
  for (std::size_t leg = 0; leg < 3; ++leg) {
    const double u_m =
        position_B.x() * cos_azimuth_[leg] + position_B.y() * sin_azimuth_[leg] + offset_u_m_;
    const double v_m =
        -position_B.x() * sin_azimuth_[leg] + position_B.y() * cos_azimuth_[leg] + offset_v_m_;
    const double w_m = position_B.z();
    if (!(std::abs(v_m) <= geometry_.shin_m)) {
      return result;
    }
    const double a_m = geometry_.thigh_m;
    const double l_m = end_pieces_m_ + std::sqrt(geometry_.shin_m * geometry_.shin_m - v_m * v_m);
    const double r_squared_m2 = u_m * u_m + w_m * w_m;
    const double r_m = std::sqrt(r_squared_m2);
    const double cosine = (r_squared_m2 + a_m * a_m - l_m * l_m) / (2.0 * a_m * r_m);
    if (!(std::abs(cosine) <= 1.0)) {
      return result;
    }
    angle_rad[static_cast<Eigen::Index>(leg)] = std::atan2(w_m, u_m) - std::acos(cosine);
    // In the triangle of thigh a, shin l and distance r: sin(theta_2 - theta_1) / r is the sine of
    // the angle between thigh and distance, over l.
    smallest_sine = std::min(smallest_sine, r_m / l_m * std::sqrt(1.0 - cosine * cosine));
  }
  if (smallest_sine < kSingularSine) {
    result.status = KinematicsStatus::kSingular;
    return result;
  }
  result.joint_angle_rad = angle_rad;
  result.counts = counts_of_angles(angle_rad);
  result.status = within_stops(angle_rad) ? KinematicsStatus::kOk : KinematicsStatus::kOutOfRange;
  return result;
}

}  // namespace forcegrid::driver
