// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "simulator/solver/elastic_object.h"
#include "simulator/solver/reduced_springs.h"

namespace forcegrid::simulator {

/// A held object as a function of n = 3 + r coordinates z = (P, q): the tool's displacement P and
/// the amplitudes q of r modes, x = X + U P + Phi q.
///
///   R(z) = R_0 - A z + R_c(z),   q solves R_q = 0,   F = R_P,   J = -(K_PP - K_Pq K_qq^-1 K_qP)
///
/// R = -dE/dz. R_c are the forces of a few weighted springs (ReducedSprings); A and R_0 hold the
/// linear part of all the others, so that at rest force and stiffness are the whole object's.
/// Forces are work-consistent: the residual R_q counts as F += (dq/dP)^T R_q. Each move predicts q
/// along dq/dP and takes Newton steps.
///
/// Source: energy-conserving sampling and weighting, Farhat, Avery, Chapman and Cortial (2014),
/// with the linear part taken out (a control variate); the modes are train_reduced_model()'s.
/// Real-time: no allocation, lock or throw in move_to(), whose time is bounded. Threads: one.
class ReducedModel {
 public:
  struct Parts {
    ReducedSprings springs;
    Eigen::MatrixXd linear_stiffness;           ///< A, n x n, symmetric
    Eigen::VectorXd rest_force;                 ///< R_0
    std::vector<Eigen::Vector3d> trained_at_W;  ///< [m] P of the states that it was trained on
    Eigen::MatrixXd trained_amplitudes;         ///< their q, r x count
  };
  explicit ReducedModel(Parts parts);

  int modes() const noexcept { return modes_; }
  std::size_t springs() const noexcept { return parts_.springs.count(); }
  std::size_t memory_bytes() const noexcept;

  /// [m] From `displacement_W` to the nearest state that it was trained on.
  double distance_m(const Eigen::Vector3d& displacement_W) const noexcept;

  /// The object's state at `displacement_W` [m] of the tool since the grab: force_W, raw_force_W
  /// (R_P alone), stiffness_W, force_gap_N, iterations (Newton steps), evaluations, reached and
  /// converged: the gap is at most 1e-3 max(|F|, 0.05 N). relative_residual is the gap over that
  /// force: the whole object's residual is not known.
  /// A displacement that is not finite changes nothing and gives converged = reached = false.
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept;

  /// z of the last answer.
  const Eigen::VectorXd& coordinates() const noexcept { return z_; }

 private:
  using Coordinates = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostReducedCoordinates, 1>;
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                               kMostReducedCoordinates, kMostReducedCoordinates>;
  using Follow = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMostReducedCoordinates, 3>;

  void start_near(const Eigen::Vector3d& displacement_W) noexcept;
  bool take_newton_step(Equilibrium& answer) noexcept;

  Parts parts_;
  int modes_ = 0;
  Eigen::VectorXd z_;
  Follow follow_;         // dq/dP at z_
  bool started_ = false;  // z_ and follow_ belong to an equilibrium
};

}  // namespace forcegrid::simulator
