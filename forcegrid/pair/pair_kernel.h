// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::pair {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// Prior covariance of the forces of two tools on one elastic object, with one energy over R^6,
///
///   (F_1, F_2)(p) = -dU/dp,   p = (P_1 - c_1, P_2 - c_2)
///
/// in newtons and metres. With d = p - q the covariance of the potential is psi(d) =
/// l^2 exp(-|d|^2 / (2 l^2)), and
///
///   Cov(F_a(p), F_b(q)) = (D_ab - d_a d_b / l^2) exp(-|d|^2 / (2 l^2)),   a, b = 1..6
///
/// (D the Kronecker delta). Each column is curl-free in R^6: dF_1/dP_2 = (dF_2/dP_1)^T in every
/// field that it spans, so one tool's samples tell of the other's force. Scaled to one newton of
/// prior standard deviation per component. To it are added a linear force of random symmetric 6x6
/// stiffness and a random constant force:
///
///   kappa/l^2 [ 1/2 ((p.q) I + q p^T) + p q^T ]  +  constant I
///
/// These are kriging::Kernel's equations in six dimensions.
/// Source: Wahlstrom et al., Modeling magnetic fields using Gaussian processes, 2013.
/// Real-time: all functions. Threads: any.
struct PairKernel {
  /// l, of the distance in R^6. Shorter than for one tool, since both tools' ways add up in it.
  double length_m = 0.020;
  double stiffness_prior = 400.0;  ///< kappa [N^2]: sqrt(kappa)/l is about 1000 N/m
  double constant_N2 = 1.0;        ///< variance of the constant force

  double stiffness_variance() const noexcept { return stiffness_prior / (length_m * length_m); }

  /// Cov(F(p), F(q)) [N^2].
  Matrix6 force_force(const PairVector& p, const PairVector& q) const noexcept {
    const PairVector d = p - q;
    const double inverse_l2 = 1.0 / (length_m * length_m);
    const double phi = std::exp(-0.5 * d.squaredNorm() * inverse_l2);
    const double s2 = stiffness_variance();
    Matrix6 k = (0.5 * s2 * q - (phi * inverse_l2) * d) * p.transpose() +
                (s2 * p + (phi * inverse_l2) * d) * q.transpose();
    k.diagonal().array() += phi + 0.5 * s2 * p.dot(q) + constant_N2;
    return k;
  }
};

}  // namespace forcegrid::pair
