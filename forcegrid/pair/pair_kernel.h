// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::pair {

using Matrix6 = PairMatrix;

/// A symmetric 6x6 stiffness as 21 numbers: its upper triangle, row after row. The kernel gives
/// their covariances in parts of six numbers, the last one of three.
inline constexpr int kStiffnessNumbers = 21;
inline constexpr int kStiffnessParts = 4;
inline constexpr int kStiffnessRow[kStiffnessNumbers] = {0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1,
                                                         2, 2, 2, 2, 3, 3, 3, 4, 4, 5};
inline constexpr int kStiffnessColumn[kStiffnessNumbers] = {0, 1, 2, 3, 4, 5, 1, 2, 3, 4, 5,
                                                            2, 3, 4, 5, 3, 4, 5, 4, 5, 5};
constexpr int part_begin(int part) noexcept { return 6 * part; }
constexpr int part_size(int part) noexcept {
  return std::min(6, kStiffnessNumbers - part_begin(part));
}

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
/// The field's derivative J = dF/dp is a quantity of the same prior: with phi = exp(-|d|^2/(2 l^2))
///
///   Cov(F_a(p), J_bc(q))  = phi/l^2 (D_ab d_c + D_ac d_b + D_bc d_a - d_a d_b d_c / l^2)
///                           + kappa/l^2 (1/2 (D_ab p_c + D_ac p_b) + D_bc p_a)
///   Cov(J_ae(p), J_bc(q)) = phi/l^2 (D_ab D_ce + D_ac D_be + D_ae D_bc
///                             - (6 terms D_xy d_z d_w) / l^2 + d_a d_b d_c d_e / l^4)
///                           + kappa/l^2 (1/2 (D_ab D_ce + D_ac D_be) + D_ae D_bc)
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

  /// Cov(F(p), J(q)) [N^2/m], a column for each number of a part; the rest is zero.
  Matrix6 force_stiffness(const PairVector& p, const PairVector& q, int part) const noexcept {
    const PairVector d = p - q;
    const double inverse_l2 = 1.0 / (length_m * length_m);
    const double g2 = std::exp(-0.5 * d.squaredNorm() * inverse_l2) * inverse_l2;
    const double s2 = stiffness_variance();
    const PairVector across = g2 * d + 0.5 * s2 * p;
    const PairVector along = g2 * d + s2 * p;
    Matrix6 k = Matrix6::Zero();
    for (int i = 0; i < part_size(part); ++i) {
      const int b = kStiffnessRow[part_begin(part) + i];
      const int c = kStiffnessColumn[part_begin(part) + i];
      k.col(i) = (-g2 * inverse_l2 * d[b] * d[c]) * d;
      k(b, i) += across[c];
      k(c, i) += across[b];
      if (b == c) {
        k.col(i) += along;
      }
    }
    return k;
  }

  /// Cov(J(p), J(q)) [N^2/m^2] of a part of each: rows of J(p), columns of J(q); the rest is zero.
  Matrix6 stiffness_stiffness(const PairVector& p, int part_p, const PairVector& q,
                              int part_q) const noexcept {
    const PairVector d = p - q;
    const double inverse_l2 = 1.0 / (length_m * length_m);
    const double g2 = std::exp(-0.5 * d.squaredNorm() * inverse_l2) * inverse_l2;
    const double g3 = -g2 * inverse_l2;
    const double s2 = stiffness_variance();
    const auto same = [](int x, int y) { return x == y ? 1.0 : 0.0; };
    Matrix6 k = Matrix6::Zero();
    for (int i = 0; i < part_size(part_p); ++i) {
      const int a = kStiffnessRow[part_begin(part_p) + i];
      const int e = kStiffnessColumn[part_begin(part_p) + i];
      for (int j = 0; j < part_size(part_q); ++j) {
        const int b = kStiffnessRow[part_begin(part_q) + j];
        const int c = kStiffnessColumn[part_begin(part_q) + j];
        const double crossed = same(a, b) * same(c, e) + same(a, c) * same(b, e);
        const double straight = same(a, e) * same(b, c);
        const double mixed = same(a, b) * d[c] * d[e] + same(a, c) * d[b] * d[e] +
                             same(a, e) * d[b] * d[c] + same(b, c) * d[a] * d[e] +
                             same(b, e) * d[a] * d[c] + same(c, e) * d[a] * d[b];
        k(i, j) = g2 * (crossed + straight) + g3 * mixed -
                  g3 * inverse_l2 * d[a] * d[b] * d[c] * d[e] + s2 * (0.5 * crossed + straight);
      }
    }
    return k;
  }
};

}  // namespace forcegrid::pair
