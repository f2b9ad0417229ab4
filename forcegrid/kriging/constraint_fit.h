// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>

#include "forcegrid/kriging/kriging_factor.h"
#include "forcegrid/kriging/unilateral_constraint.h"

namespace forcegrid::kriging {

/// Up to two one-sided constraints in addition to a smooth field: their stiffnesses and shapes,
/// fitted to the field's samples.
///
///   F(p) = sum_i K(p, p_i) alpha_i + sum_h (k1 phi_h + k2 phi_h^2) grad s_h
///
/// with k1 ~ N(0, (1000 N/m)^2) and k2 ~ N(0, (3e4 N/m^2)^2). These are linear, columns U of a
/// covariance K + U U^T, and are solved with the field: with L the factor without them,
///
///   X = L^-1 U,  G = I + X^T X,  beta = G^-1 X^T y,  alpha = L^-T (y - X beta).
///
/// The shapes that the samples support have the largest gain
///
///   gain = y^T X beta / (2 s2) - 1/2 ln|G| - 1/2 (c / (40 /m))^2 - 1/2 (ln(e / 50 um) / 1.5)^2,
///
/// where s2 is the scale of the data before the surprise, and at least one.
///
/// Refinement: Newton steps with the Gauss-Newton matrix of |y - X beta|^2, with beta eliminated
/// (variable projection), in n, depth, c and e, damped until the gain rises.
///
/// A constraint never pulls: k1 <= 0 and k1 + k2 phi <= 0 at the deepest sample. k2 is left out
/// where it would pull, and a shape that still pulls is refused.
///
/// Use: set_rows() whenever the factor or its samples have changed, then refit(), then the others.
/// Source: docs/kriging.md; variable projection: Golub and Pereyra, 2003; evidence: Rasmussen and
/// Williams, 2006, sections 2.7 and 5.4.
/// The derivative of X beta takes one solve per parameter, L^-1 dU beta. What G adds to the slope,
/// tr(G^-1 X^T dX), needs none: it is tr(Z^T dU) with Z = L^-T X G^-1, two columns for all five.
/// Real-time: nothing allocates, locks or throws. Cost: a Newton step is three triangular solves
/// with three right-hand sides, and two of one. Threads: one.
class ConstraintFit {
 public:
  static constexpr int kMaxConstraints = 2;
  static constexpr int kMaxSamples = 48;
  static constexpr int kStepsOnSurprise = 10;
  using Factor = GrowingCholesky<3 * kMaxSamples>;
  using Shapes = std::array<UnilateralConstraint, kMaxConstraints>;
  using Weights = Eigen::Matrix<double, 2 * kMaxConstraints, 1>;
  using Inverse = Eigen::Matrix<double, 2 * kMaxConstraints, 2 * kMaxConstraints>;
  using Column = std::array<double, Factor::kStride>;

  /// X of a constraint: for k1 and k2 in units of their prior deviation; and room for one more.
  struct Columns {
    alignas(64) std::array<Column, 3> x{};  // solved three at a time
    double deepest_m = 0.0;                 ///< phi of the deepest sample
    int active = 0;                         ///< samples beyond the surface
  };
  struct Solution {
    Inverse inverse = Inverse::Identity();  ///< G^-1
    Weights weight = Weights::Zero();       ///< beta
    double explained = 0.0;                 ///< y^T X beta
    double gain = 0.0;                      ///< [nats] without the priors of the shapes
    bool pushes = true;
  };

  /// Of their rows from `first` on.
  static double dot(const Column& a, const Column& b, int first, int rows) noexcept {
    using Rows = Eigen::Map<const Eigen::VectorXd>;
    return Rows(a.data() + first, rows - first).dot(Rows(b.data() + first, rows - first));
  }

  /// @param nugget_N2 noise variance of a sample.
  explicit ConstraintFit(double nugget_N2) noexcept : nugget_N2_(nugget_N2) {}

  /// The smooth field's factor, three rows per sample, and the positions of these samples. The
  /// factor must not change while the functions below are used.
  template <typename PositionOfSample>
  void set_rows(const Factor& factor, int samples, const PositionOfSample& position_W) noexcept {
    factor_ = &factor;
    position_count_ = samples;
    for (int i = 0; i < samples; ++i) {
      positions_W_[static_cast<std::size_t>(i)] = position_W(i);
    }
  }
  /// s2, see above.
  void set_data_scale(double scale) noexcept { data_scale_ = scale; }

  /// Replaces the constraints by up to kMaxConstraints others. refit() must follow.
  void set_constraints(std::span<const UnilateralConstraint> constraints) noexcept;
  void set_constraints(const Shapes& shapes, int count) noexcept {
    set_constraints(std::span(shapes).first(static_cast<std::size_t>(count)));
  }
  const Shapes& constraints() const noexcept { return constraints_; }
  int count() const noexcept { return count_; }

  /// Solves for the stiffnesses of the present constraints.
  void refit() noexcept;
  /// Improves one constraint while the others stay as they are, by at most `steps` Newton steps.
  /// @returns the gain of all.
  double refine(int index, int steps) noexcept;
  /// The same in pieces: refine_once() takes one step, and returns whether another one is due.
  void begin_refining(int index, int steps) noexcept {
    refined_ = index;
    steps_left_ = steps;
    damping_ = kFirstDamping;
  }
  bool refine_once() noexcept;
  /// The same for a constraint that another shape replaces.
  void begin_refining_from(int index, const UnilateralConstraint& shape, int steps) noexcept {
    constraints_[static_cast<std::size_t>(index)] = shape;
    refit();
    begin_refining(index, steps);
  }
  /// Drops constraints that the samples support with less than 3 nats.
  void drop_unneeded() noexcept;

  /// [nats] Of all constraints, including the priors of their shapes; -infinity if one pulls.
  double gain() const noexcept { return gain(solution_); }
  /// [nats] How much more the samples support a constraint than none, as drop_unneeded() found.
  double gain_of(int index) const noexcept { return gains_[static_cast<std::size_t>(index)]; }
  /// Whether field and constraints together explain all samples.
  bool explains_all_samples() noexcept;
  /// Whether a sample at `position_W` is one of the few that a constraint rests on.
  bool rests_on(const Eigen::Vector3d& position_W) const noexcept;

  /// k1 [N/m] and k2 [N/m^2], negative where the constraint pushes.
  Eigen::Vector2d stiffness(int index) const noexcept;
  /// [N] What a constraint of this stiffness(), k, adds to the force; it never pulls.
  static Eigen::Vector3d push_N(const UnilateralConstraint& shape, const Eigen::Vector2d& k,
                                const Eigen::Vector3d& position_W) noexcept;
  /// [N/m] d push_N / dP.
  static Eigen::Matrix3d push_stiffness_N_per_m(const UnilateralConstraint& shape,
                                                const Eigen::Vector2d& k,
                                                const Eigen::Vector3d& position_W) noexcept;
  /// Adds the constraints' part to mean and covariance of the force at `position_W`. Needs its
  /// covariances with the factor's rows, solved.
  void add_features(const Eigen::Vector3d& position_W, int rows, const Factor::Columns& x,
                    Eigen::Vector3d& mean_N, Eigen::Matrix3d& covariance_N2) const noexcept;

  /// residual() <- y - X beta.
  void update_residual() noexcept { leave_over(solution_); }
  const Column& residual() const noexcept { return residual_; }
  const Solution& solution() const noexcept { return solution_; }
  const Columns& columns(int index) const noexcept {
    return columns_[static_cast<std::size_t>(index)];
  }
  const Factor& factor() const noexcept { return *factor_; }
  std::span<const Eigen::Vector3d> positions_W() const noexcept {
    return std::span(positions_W_).first(static_cast<std::size_t>(position_count_));
  }
  double data_scale() const noexcept { return data_scale_; }

 private:
  static constexpr int kParameters = UnilateralConstraint::kParameters;
  static constexpr double kFirstDamping = 0.03;
  using Set = std::array<const Columns*, kMaxConstraints>;  ///< nullptr: no constraint

  void solve_columns(const UnilateralConstraint& constraint, Columns& columns) const noexcept;
  Solution solve(const Set& set) const noexcept;
  double gain(const Solution& fit) const noexcept;
  bool step_is_better() noexcept;
  void leave_over(const Solution& fit) noexcept;
  bool derive(int index, const Solution& fit, Eigen::Matrix<double, kParameters, 1>& slope,
              Eigen::Matrix<double, kParameters, kParameters>& curvature) noexcept;

  double nugget_N2_;
  const Factor* factor_ = nullptr;
  std::array<Eigen::Vector3d, kMaxSamples> positions_W_;
  int position_count_ = 0;
  double data_scale_ = 1.0;

  Shapes constraints_;
  std::array<double, kMaxConstraints> gains_{};
  int count_ = 0;
  std::array<Columns, kMaxConstraints> columns_;
  Solution solution_;
  Columns trial_;
  std::array<Column, 6> changed_{};     ///< d (X beta) by each parameter; solved three at a time
  std::array<Column, 2> per_column_{};  ///< Z
  Column residual_{};

  int refined_ = 0;  ///< of the constraints, by refine_once()
  int steps_left_ = 0;
  double damping_ = kFirstDamping;
};

}  // namespace forcegrid::kriging
