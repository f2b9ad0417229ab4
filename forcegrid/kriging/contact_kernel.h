// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "forcegrid/kriging/kriging_kernel.h"

namespace forcegrid::kriging {

/// Prior covariance of the forces of one object touched at many places. d is the tool's
/// displacement since it touched at c; c is a further coordinate of the field:
///
///   Cov(F(d, c), F(d', c')) = g(c, c') [ C(d, d') - C(d, 0) C(0, d') + S(d, d') ]
///   g(c, c') = r0 + (1 - r0) exp(-|c - c'|^2 / (2 lc^2))
///
/// with C the curl-free squared exponential and S the random symmetric stiffness of Kernel. Without
/// the middle term this is a product of a covariance in d and one in c. C(0, 0) = I and S(0, .) =
/// 0, so the middle term is the effect of conditioning on F(0, c) = 0, for all c at once: a tool
/// that has just touched feels nothing, wherever it touched. The zero is exact and costs no sample.
/// Every column stays curl-free in d.
///
/// r0 is the part that all places of an object have in common. Lengths in metres, forces in
/// newtons.
/// Source: docs/kriging.md; Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
/// sections 2.2 (conditioning) and 4.2.4 (products of covariances).
struct ContactKernel {
  Kernel field{.constant_N2 = 0.0};  ///< of squared exponential shape, without history
  double shared = 0.8;               ///< r0, in 0..1
  double place_m = 0.025;            ///< lc

  /// g.
  double similarity(const Eigen::Vector3d& c, const Eigen::Vector3d& other_c) const noexcept {
    return shared +
           (1.0 - shared) * std::exp(-0.5 * (c - other_c).squaredNorm() / (place_m * place_m));
  }

  /// C(d, 0), a symmetric matrix.
  Eigen::Matrix3d with_origin(const Eigen::Vector3d& d) const noexcept {
    const RadialDerivatives g = field.radial(d.squaredNorm());
    Eigen::Matrix3d k = -g.g2 * d * d.transpose();
    k.diagonal().array() -= g.g1;
    return k;
  }

  /// The covariance at one place, g = 1. @param d_origin, other_origin with_origin() of d, other_d.
  Eigen::Matrix3d force_force(const Eigen::Vector3d& d, const Eigen::Matrix3d& d_origin,
                              const Eigen::Vector3d& other_d,
                              const Eigen::Matrix3d& other_origin) const noexcept {
    static const History kNone = History::Zero();
    return field.force_force(d, kNone, other_d, kNone) - d_origin * other_origin;
  }

  /// Prior variance of one component of the force, averaged over the axes [N^2].
  double prior_variance_N2(const Eigen::Vector3d& d) const noexcept {
    return 1.0 - with_origin(d).squaredNorm() / 3.0 + field.stiffness_variance() * d.squaredNorm();
  }
};

}  // namespace forcegrid::kriging
