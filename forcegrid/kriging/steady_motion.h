// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::kriging {

/// An object that moves steadily, and what samples of its force tell of the motion, together with
/// the field that is learned from the same samples:
///
///   F_k = f(P_k - d(t_k)) + noise,   d(t) = d_c + v (t - t_c),   (d_c, v) = start + eta,
///
/// eta ~ N(0, prior), f a Gaussian process with the covariance K = L L^T of the samples, noise
/// included. Linear in eta about what was thought, eta_k, when a sample came, with f's stiffness
/// S_k there:
///
///   F_k = f(P_k - d_k) + B_k (eta - eta_k),   B_k = -S_k [I, (t_k - t_c) I],
///
/// so with y = L^-1 F, Y_B = L^-1 B and y_C of C_k = B_k eta_k carried along with the factor,
///
///   covariance = (prior^-1 + Y_B^T Y_B / s2)^-1,   eta = covariance Y_B^T (y + y_C) / s2,
///
/// f has the data y + y_C - Y_B eta, and s2 >= 1 is the mean square of what that leaves. Samples
/// from before t_c have B_k = 0: f and the motion are told apart by these, and by the times.
///
/// Shapes: kTerms columns of B_k and C_k, 3 rows each [N]; eta [m, m/s].
/// Failure: shifts so wrong that the force is not linear over the error; velocities that change
/// (the owner begins anew).
/// Source: Rasmussen and Williams (2006), section 2.7, for explicit basis functions;
/// docs/kriging.md. Real-time: nothing allocates, locks or throws. Threads: one.
class SteadyMotion {
 public:
  static constexpr int kUnknowns = 6;
  static constexpr int kTerms = kUnknowns + 1;
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;  ///< of d and v
  using Covariance = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  using Columns = Eigen::Matrix<double, 3, kUnknowns>;
  using Terms = Eigen::Matrix<double, 3, kTerms>;
  using Products = Eigen::Matrix<double, kTerms + 1, kTerms + 1>;

  /// From `time_s` on. @param covariance of both at that time, positive definite.
  void begin(double time_s, const Eigen::Vector3d& shift_m, const Eigen::Vector3d& velocity_m_per_s,
             const Covariance& covariance) noexcept;
  /// Learns eta from all samples. @param products the factor's, of B_k, C_k and the forces.
  /// @returns false, and is of no use until it begins again, if that is no motion.
  bool fit(const Products& products, int rows) noexcept;

  const Vector& eta() const noexcept { return eta_; }
  const Covariance& covariance() const noexcept { return covariance_; }  ///< of eta
  Covariance covariance_at(double time_s) const noexcept;                ///< of d(time_s) and v
  Eigen::Vector3d shift_m(double time_s, const Vector& eta) const noexcept;
  Eigen::Vector3d velocity_m_per_s() const noexcept { return (start_ + eta_).tail<3>(); }
  /// What a sample carries that is made linear about `eta`. @param slope_N_per_m S_k
  Terms terms(double time_s, const Eigen::Matrix3d& slope_N_per_m,
              const Vector& eta) const noexcept;
  /// How the carried data add to the forces to make those of f.
  Eigen::Matrix<double, kTerms, 1> factors() const noexcept;
  /// The part of |y|^2 that it explains.
  double explained_squares() const noexcept { return explained_squares_; }
  /// d(time_s) = design(time_s) (d_c, v)
  Columns design(double time_s) const noexcept;

 private:
  double begin_s_ = 0.0;
  Vector start_ = Vector::Zero();
  Vector eta_ = Vector::Zero();
  Covariance prior_inverse_ = Covariance::Identity();
  Covariance covariance_ = Covariance::Identity();
  double explained_squares_ = 0.0;
};

}  // namespace forcegrid::kriging
