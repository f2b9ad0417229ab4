// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

namespace forcegrid::kriging {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A symmetric stiffness as six numbers: xx, yy, zz, xy, xz, yz.
inline constexpr int kStiffnessRow[6] = {0, 1, 2, 0, 0, 1};
inline constexpr int kStiffnessColumn[6] = {0, 1, 2, 1, 2, 2};

/// The matrix [N/m] of these six.
inline Eigen::Matrix3d stiffness_matrix(const Vector6d& stiffness_N_per_m) noexcept {
  Eigen::Matrix3d matrix;
  for (int i = 0; i < 6; ++i) {
    matrix(kStiffnessRow[i], kStiffnessColumn[i]) = stiffness_N_per_m[i];
    matrix(kStiffnessColumn[i], kStiffnessRow[i]) = stiffness_N_per_m[i];
  }
  return matrix;
}

/// [s] Filters of the tool's path whose lag is a history feature.
inline constexpr int kHistoryFeatures = 3;
/// [m] Column j is P - LP_j(P), how far the tool is ahead of its own low-passed path.
using History = Eigen::Matrix<double, 3, kHistoryFeatures>;

/// How the covariance of two forces falls with their distance.
enum class RadialShape : std::uint8_t { kSquaredExponential, kMatern72 };

/// Derivatives g' to g'''' of the potential's covariance psi = g(u) with respect to u = r^2/2.
struct RadialDerivatives {
  double g1, g2, g3, g4;
};

/// Prior covariance of a conservative force field and of its stiffness, over positions relative to
/// the contact point, in newtons and metres. With d = p - q and psi(d) = g(|d|^2/2) the covariance
/// of the potential,
///
///   Cov(F_a(p), F_b(q))   = -D_ab g' - d_a d_b g''
///   Cov(F_a(p), J_bc(q))  = (D_ab d_c + D_ac d_b + D_bc d_a) g'' + d_a d_b d_c g'''
///   Cov(J_ae(p), J_bc(q)) = (D_ab D_ce + D_ac D_be + D_ae D_bc) g'' + (6 terms D_xy d_z d_w) g'''
///                           + d_a d_b d_c d_e g''''
///
/// (D the Kronecker delta, J = dF/dP), each column of the first being curl-free in p. Scaled so
/// that -g'(0) = 1: one newton of prior standard deviation per axis. The shapes:
///
///   squared exponential  g = l^2 exp(-u/l^2)
///   Matern 7/2           -g' = (1 + s + s^2/3) exp(-s),  s = sqrt(7) r/l
///
/// To these are added a linear force of random symmetric stiffness, a random constant force, and
/// for objects that remember (viscosity) one random linear map of each history feature:
///
///   kappa/l^2 [ 1/2 ((p.q) I + q p^T) + p q^T ]  +  constant I  +  kf (9/l^2) (sum_j h_j.h'_j) I
///
/// Source: Wahlstrom et al., Modeling magnetic fields using Gaussian processes, 2013 (curl-free
/// kernels); Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 4.2
/// (Matern) and 9.4 (derivative observations).
struct Kernel {
  RadialShape shape = RadialShape::kSquaredExponential;
  double length_m = 0.030;        ///< l
  double stiffness_prior = 1000;  ///< kappa [N^2]: sqrt(kappa)/l is about 1000 N/m
  double constant_N2 = 1.0;       ///< variance of the constant force
  double history_gain = 0.0;      ///< kf [N^2]; 0: no history features

  double stiffness_variance() const noexcept { return stiffness_prior / (length_m * length_m); }
  double history_variance() const noexcept { return 9.0 * history_gain / (length_m * length_m); }

  RadialDerivatives radial(double distance_m2) const noexcept;

  /// Prior variance of one component of the force, averaged over the axes [N^2].
  double prior_variance_N2(const Eigen::Vector3d& p, const History& h) const noexcept {
    return 1.0 + constant_N2 + stiffness_variance() * p.squaredNorm() +
           history_variance() * h.squaredNorm();
  }

  /// Cov(F(p), F(q)) [N^2].
  Eigen::Matrix3d force_force(const Eigen::Vector3d& p, const History& hp, const Eigen::Vector3d& q,
                              const History& hq) const noexcept;
  /// Cov(F(p), J(q)) [N^2/m], columns in the order of kStiffnessRow.
  Matrix36d force_stiffness(const Eigen::Vector3d& p, const Eigen::Vector3d& q) const noexcept;
  /// Cov(J(p), J(q)) [N^2/m^2].
  Matrix6d stiffness_stiffness(const Eigen::Vector3d& p, const Eigen::Vector3d& q) const noexcept;
};

inline RadialDerivatives Kernel::radial(double distance_m2) const noexcept {
  const double inverse_l2 = 1.0 / (length_m * length_m);
  if (shape == RadialShape::kSquaredExponential) {
    const double phi = std::exp(-0.5 * distance_m2 * inverse_l2);
    return {-phi, phi * inverse_l2, -phi * inverse_l2 * inverse_l2,
            phi * inverse_l2 * inverse_l2 * inverse_l2};
  }
  const double k2 = 7.0 * inverse_l2;
  const double s = std::sqrt(k2 * distance_m2);
  const double e = std::exp(-s);
  // g'''' has a pole at s = 0, where the d_a d_b d_c d_e that it multiplies falls faster.
  return {-(1.0 + s + s * s / 3.0) * e, k2 / 3.0 * (1.0 + s) * e, -k2 * k2 / 3.0 * e,
          s > 1e-12 ? k2 * k2 * k2 / 3.0 * e / s : 0.0};
}

inline Eigen::Matrix3d Kernel::force_force(const Eigen::Vector3d& p, const History& hp,
                                           const Eigen::Vector3d& q,
                                           const History& hq) const noexcept {
  const Eigen::Vector3d d = p - q;
  const RadialDerivatives g = radial(d.squaredNorm());
  const double s2 = stiffness_variance();
  Eigen::Matrix3d k = s2 * (0.5 * q * p.transpose() + p * q.transpose()) - g.g2 * d * d.transpose();
  k.diagonal().array() += 0.5 * s2 * p.dot(q) + constant_N2 - g.g1;
  if (history_gain > 0.0) {
    k.diagonal().array() += history_variance() * hp.cwiseProduct(hq).sum();
  }
  return k;
}

inline Matrix36d Kernel::force_stiffness(const Eigen::Vector3d& p,
                                         const Eigen::Vector3d& q) const noexcept {
  const Eigen::Vector3d d = p - q;
  const RadialDerivatives g = radial(d.squaredNorm());
  const double s2 = stiffness_variance();
  Matrix36d k;
  for (int i = 0; i < 6; ++i) {
    const int b = kStiffnessRow[i];
    const int c = kStiffnessColumn[i];
    k.col(i) = (g.g3 * d[b] * d[c]) * d;
    k(b, i) += g.g2 * d[c] + 0.5 * s2 * p[c];
    k(c, i) += g.g2 * d[b] + 0.5 * s2 * p[b];
    if (b == c) {
      k.col(i) += g.g2 * d + s2 * p;
    }
  }
  return k;
}

inline Matrix6d Kernel::stiffness_stiffness(const Eigen::Vector3d& p,
                                            const Eigen::Vector3d& q) const noexcept {
  const Eigen::Vector3d d = p - q;
  const RadialDerivatives g = radial(d.squaredNorm());
  const double s2 = stiffness_variance();
  const auto same = [](int x, int y) { return x == y ? 1.0 : 0.0; };
  Matrix6d k;
  for (int i = 0; i < 6; ++i) {
    const int a = kStiffnessRow[i];
    const int e = kStiffnessColumn[i];
    for (int j = i; j < 6; ++j) {
      const int b = kStiffnessRow[j];
      const int c = kStiffnessColumn[j];
      const double crossed = same(a, b) * same(c, e) + same(a, c) * same(b, e);
      const double straight = same(a, e) * same(b, c);
      k(i, j) = k(j, i) =
          (g.g2 * (crossed + straight)) +
          g.g3 * (same(a, b) * d[c] * d[e] + same(a, c) * d[b] * d[e] + same(a, e) * d[b] * d[c] +
                  same(b, c) * d[a] * d[e] + same(b, e) * d[a] * d[c] + same(c, e) * d[a] * d[b]) +
          g.g4 * d[a] * d[b] * d[c] * d[e] + s2 * (0.5 * crossed + straight);
    }
  }
  return k;
}

}  // namespace forcegrid::kriging
