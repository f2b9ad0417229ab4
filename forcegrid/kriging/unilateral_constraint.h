// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::kriging {

/// The shape of a second object that the tool may be pushed against: a plane or a ball, hard or
/// with a soft edge. Positions in the workspace frame W, in metres.
///
///   s(p) = (1 - |w|) / c,  w = n - c (p - a),   a = t - depth n;   n.(p - a) where c = 0
///   grad s = w / |w|,   phi = e ln(1 + exp(s/e))
///
/// n is the surface's normal into the object where it is nearest to the anchor t, c the curvature,
/// positive of a ball, negative of the inside of one. Turning n turns the surface about t.
struct UnilateralConstraint {
  Eigen::Vector3d anchor_W = Eigen::Vector3d::Zero();   ///< t
  Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< n
  double depth_m = 0.0;                                 ///< s(t)
  double curvature_per_m = 0.0;                         ///< c
  double softness_m = 5e-5;                             ///< e, above zero

  struct At {
    double depth_m;            ///< s
    double penetration_m;      ///< phi
    Eigen::Vector3d inward_W;  ///< grad s
  };
  At at(const Eigen::Vector3d& position_W) const noexcept;
  /// [m] phi at a depth s.
  double penetration_m(double s_m) const noexcept;

  // Prior deviations of its weights and of its shape.
  static constexpr double kStiffness_N_per_m = 1000.0;
  static constexpr double kStiffening_N_per_m2 = 3e4;
  static constexpr double kCurvature_per_m = 40.0;
  static constexpr double kUsualSoftness_m = 5e-5;
  static constexpr double kLnSoftness = 1.5;
  static constexpr double kHardest_m = 1e-5;  ///< within these
  static constexpr double kSoftest_m = 3e-3;

  /// -ln of the shape's prior, but for a constant [nats].
  double prior_nats() const noexcept;

  /// Two of n, depth, c and ln e, in units of kUnit.
  static constexpr int kParameters = 5;
  using Parameters = Eigen::Matrix<double, kParameters, 1>;
  static constexpr double kUnit[kParameters] = {0.1, 0.1, 1e-3, 10.0, 0.5};
  /// The shape with its parameters changed by `step`.
  UnilateralConstraint moved(const Parameters& step) const noexcept;
  /// The shape with another curvature, as hard as usual.
  UnilateralConstraint bent(double to_per_m) const noexcept {
    UnilateralConstraint result = *this;
    result.curvature_per_m = to_per_m;
    result.softness_m = kUsualSoftness_m;
    return result;
  }
};

}  // namespace forcegrid::kriging
