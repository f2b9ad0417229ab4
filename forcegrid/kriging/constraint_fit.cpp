// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/constraint_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;
using Shape = UnilateralConstraint;

constexpr double kDrop_nats = 3.0;
constexpr double kConverged_nats = 0.02;
constexpr double kExplainedScale = 3.0;       // of the previous scale of the data
constexpr double kExplainedDeviations = 4.0;  // of a sample's noise
constexpr int kSamplesNeeded = 6;             // beyond a surface; such samples are never dropped
constexpr int kTriesOfAStep = 3;
constexpr double kLargestStep[5] = {3.0, 3.0, 2.0, 2.0, 1.5};
constexpr double kDifference = 1e-4;  // of a unit

}  // namespace

void ConstraintFit::set_constraints(std::span<const UnilateralConstraint> constraints) noexcept {
  count_ = static_cast<int>(std::min<std::size_t>(constraints.size(), kMaxConstraints));
  std::copy_n(constraints.begin(), count_, constraints_.begin());
}

bool ConstraintFit::rests_on(const Vector3d& position_W) const noexcept {
  for (int h = 0; h < count_; ++h) {
    const UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(h)];
    if (columns_[static_cast<std::size_t>(h)].active <= kSamplesNeeded &&
        constraint.at(position_W).penetration_m > constraint.softness_m) {
      return true;
    }
  }
  return false;
}

Eigen::Vector2d ConstraintFit::stiffness(int index) const noexcept {
  return {Shape::kStiffness_N_per_m * solution_.weight[2 * index],
          Shape::kStiffening_N_per_m2 * solution_.weight[2 * index + 1]};
}

Vector3d ConstraintFit::push_N(const UnilateralConstraint& shape, const Eigen::Vector2d& k,
                               const Vector3d& position_W) noexcept {
  const UnilateralConstraint::At at = shape.at(position_W);
  return std::min(0.0, (k[0] + k[1] * at.penetration_m) * at.penetration_m) * at.inward_W;
}

// Derivative of m(phi) u, u = grad s: m' dphi/ds u u^T + m grad u. The curvature of a ball's
// distance is that of the ball through P.
Eigen::Matrix3d ConstraintFit::push_stiffness_N_per_m(const UnilateralConstraint& shape,
                                                      const Eigen::Vector2d& k,
                                                      const Vector3d& position_W) noexcept {
  const UnilateralConstraint::At at = shape.at(position_W);
  const double push_N = (k[0] + k[1] * at.penetration_m) * at.penetration_m;
  if (push_N >= 0.0) {
    return Eigen::Matrix3d::Zero();
  }
  const double per_depth = 1.0 / (1.0 + std::exp(-at.depth_m / shape.softness_m));  // dphi/ds
  const double length = 1.0 - shape.curvature_per_m * at.depth_m;                   // |w|
  const Eigen::Matrix3d along = at.inward_W * at.inward_W.transpose();
  const double bend_N_per_m =
      std::abs(length) > 1e-9 ? -push_N * shape.curvature_per_m / length : 0.0;
  return (k[0] + 2.0 * k[1] * at.penetration_m) * per_depth * along +
         bend_N_per_m * (Eigen::Matrix3d::Identity() - along);
}

void ConstraintFit::add_features(const Vector3d& position_W, int rows, const Factor::Columns& x,
                                 Vector3d& mean_N, Eigen::Matrix3d& covariance_N2) const noexcept {
  if (count_ == 0) {
    return;
  }
  // The effect of a constraint at p beyond the one that the rows already have there.
  Eigen::Matrix<double, 3, 2 * kMaxConstraints> left;
  left.setZero();
  for (int h = 0; h < count_; ++h) {
    const UnilateralConstraint::At at = constraints_[static_cast<std::size_t>(h)].at(position_W);
    left.col(2 * h) = Shape::kStiffness_N_per_m * at.penetration_m * at.inward_W;
    left.col(2 * h + 1) =
        Shape::kStiffening_N_per_m2 * at.penetration_m * at.penetration_m * at.inward_W;
    for (int i = 0; i < 2; ++i) {
      const Column& column = columns_[static_cast<std::size_t>(h)].x[static_cast<std::size_t>(i)];
      for (int c = 0; c < 3; ++c) {
        left(c, 2 * h + i) -= dot(x.column[static_cast<std::size_t>(c)], column, 0, rows);
      }
    }
  }
  mean_N += left * solution_.weight;
  covariance_N2 += left * solution_.inverse * left.transpose();
}

void ConstraintFit::solve_columns(const UnilateralConstraint& constraint,
                                  Columns& columns) const noexcept {
  columns.deepest_m = 0.0;
  columns.active = 0;
  int first = factor_->rows();
  std::size_t row = 0;
  for (int b = 0; b < position_count_; ++b, row += 3) {
    const UnilateralConstraint::At at = constraint.at(positions_W_[static_cast<std::size_t>(b)]);
    const double phi_m = at.penetration_m;
    for (int a = 0; a < 3; ++a) {
      const std::size_t r = row + static_cast<std::size_t>(a);
      columns.x[0][r] = Shape::kStiffness_N_per_m * phi_m * at.inward_W[a];
      columns.x[1][r] = Shape::kStiffening_N_per_m2 * phi_m * phi_m * at.inward_W[a];
      columns.x[2][r] = 0.0;
    }
    if (phi_m > 0.0) {
      first = std::min(first, static_cast<int>(row));
      columns.deepest_m = std::max(columns.deepest_m, phi_m);
      columns.active += phi_m > constraint.softness_m ? 1 : 0;
    }
  }
  double* const three[3] = {columns.x[0].data(), columns.x[1].data(), columns.x[2].data()};
  factor_->solve_from(first, three);
}

ConstraintFit::Solution ConstraintFit::solve(const Set& set) const noexcept {
  const int rows = factor_->rows();
  Inverse products = Inverse::Zero();
  Weights seen = Weights::Zero();
  std::array<const Column*, 2 * kMaxConstraints> column{};
  std::array<bool, 2 * kMaxConstraints> used{};
  for (std::size_t h = 0; h < kMaxConstraints; ++h) {
    if (set[h] != nullptr) {
      column[2 * h] = &set[h]->x[0];
      column[2 * h + 1] = &set[h]->x[1];
      used[2 * h] = used[2 * h + 1] = true;
    }
  }
  for (std::size_t i = 0; i < column.size(); ++i) {
    if (!used[i]) {
      continue;
    }
    seen[static_cast<int>(i)] = dot(*column[i], factor_->y(), 0, rows);
    for (std::size_t j = 0; j <= i; ++j) {
      const double sum = used[j] ? dot(*column[i], *column[j], 0, rows) : 0.0;
      products(static_cast<int>(i), static_cast<int>(j)) = sum;
      products(static_cast<int>(j), static_cast<int>(i)) = sum;
    }
  }
  Solution fit;
  for (bool again = true; again;) {
    again = false;
    fit.pushes = true;
    Inverse g = Inverse::Identity();
    Weights b = Weights::Zero();
    for (int i = 0; i < 2 * kMaxConstraints; ++i) {
      if (!used[static_cast<std::size_t>(i)]) {
        continue;
      }
      b[i] = seen[i];
      for (int j = 0; j < 2 * kMaxConstraints; ++j) {
        if (used[static_cast<std::size_t>(j)]) {
          g(i, j) += products(i, j);
        }
      }
    }
    const Eigen::LLT<Inverse> factor(g);
    fit.inverse = factor.solve(Inverse::Identity());
    fit.weight = factor.solve(b);
    fit.explained = b.dot(fit.weight);
    fit.gain =
        0.5 * fit.explained / data_scale_ - factor.matrixLLT().diagonal().array().log().sum();
    for (std::size_t h = 0; h < kMaxConstraints; ++h) {
      if (set[h] == nullptr) {
        continue;
      }
      const int i = 2 * static_cast<int>(h);
      const double k1 = Shape::kStiffness_N_per_m * fit.weight[i];
      const double k2 = Shape::kStiffening_N_per_m2 * fit.weight[i + 1];
      if (k1 > 0.0 || k1 + k2 * set[h]->deepest_m > 0.0) {
        fit.pushes = false;
        again = again || used[2 * h + 1];
        used[2 * h + 1] = false;
      }
    }
  }
  if (!std::isfinite(fit.gain)) {
    fit.pushes = false;
  }
  for (int i = 0; i < 2 * kMaxConstraints; ++i) {
    if (!used[static_cast<std::size_t>(i)]) {
      fit.inverse(i, i) = 0.0;
    }
  }
  return fit;
}

// residual_ = y - X beta.
void ConstraintFit::leave_over(const Solution& fit) noexcept {
  for (std::size_t r = 0; r < static_cast<std::size_t>(factor_->rows()); ++r) {
    double left = factor_->y(static_cast<int>(r));
    for (int h = 0; h < count_; ++h) {
      const Columns& c = columns_[static_cast<std::size_t>(h)];
      left -= c.x[0][r] * fit.weight[2 * h] + c.x[1][r] * fit.weight[2 * h + 1];
    }
    residual_[r] = left;
  }
}

// Of all constraints, including the priors of their shapes.
double ConstraintFit::gain(const Solution& fit) const noexcept {
  if (!fit.pushes) {
    return -std::numeric_limits<double>::infinity();
  }
  double nats = fit.gain;
  for (int h = 0; h < count_; ++h) {
    nats -= constraints_[static_cast<std::size_t>(h)].prior_nats();
  }
  return nats;
}

// Slope and Gauss-Newton curvature of the gain with respect to the parameters of a shape.
bool ConstraintFit::derive(int index, const Solution& fit,
                           Eigen::Matrix<double, kParameters, 1>& slope,
                           Eigen::Matrix<double, kParameters, kParameters>& curvature) noexcept {
  const int rows = factor_->rows();
  const UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  const int at = 2 * index;
  leave_over(fit);
  int first = rows;
  for (int b = 0; b < position_count_ && first == rows; ++b) {
    if (constraint.at(positions_W_[static_cast<std::size_t>(b)]).penetration_m > 0.0) {
      first = 3 * b;
    }
  }
  if (first == rows) {
    return false;
  }
  for (std::size_t i = 0; i < per_column_.size(); ++i) {
    Column& z = per_column_[i];
    z.fill(0.0);
    for (int h = 0; h < count_; ++h) {
      const Columns& c = columns_[static_cast<std::size_t>(h)];
      const double g1 = fit.inverse(at + static_cast<int>(i), 2 * h);
      const double g2 = fit.inverse(at + static_cast<int>(i), 2 * h + 1);
      for (std::size_t r = static_cast<std::size_t>(first); r < static_cast<std::size_t>(rows);
           ++r) {
        z[r] += g1 * c.x[0][r] + g2 * c.x[1][r];
      }
    }
    factor_->solve_transposed_from(first, z.data());
  }
  std::array<UnilateralConstraint, kParameters> shifted;
  for (int j = 0; j < kParameters; ++j) {
    Eigen::Matrix<double, kParameters, 1> step = Eigen::Matrix<double, kParameters, 1>::Zero();
    step[j] = kDifference;
    shifted[static_cast<std::size_t>(j)] = constraint.moved(step);
  }
  for (Column& changed : changed_) {
    changed.fill(0.0);
  }
  slope.setZero();
  for (int b = first / 3; b < position_count_; ++b) {
    const Vector3d position_W = positions_W_[static_cast<std::size_t>(b)];
    const UnilateralConstraint::At here = constraint.at(position_W);
    if (here.penetration_m <= 0.0) {
      continue;
    }
    const Vector3d first_N = here.penetration_m * here.inward_W;
    const Vector3d second_N = here.penetration_m * first_N;
    const auto row = static_cast<std::size_t>(3 * b);
    for (std::size_t j = 0; j < kParameters; ++j) {
      const UnilateralConstraint::At there = shifted[j].at(position_W);
      const Vector3d pushed = there.penetration_m * there.inward_W;
      const Vector3d d1 = Shape::kStiffness_N_per_m / kDifference * (pushed - first_N);
      const Vector3d d2 =
          Shape::kStiffening_N_per_m2 / kDifference * (there.penetration_m * pushed - second_N);
      for (int a = 0; a < 3; ++a) {
        const std::size_t r = row + static_cast<std::size_t>(a);
        slope[static_cast<int>(j)] -= per_column_[0][r] * d1[a] + per_column_[1][r] * d2[a];
        changed_[j][r] = d1[a] * fit.weight[at] + d2[a] * fit.weight[at + 1];
      }
    }
  }
  for (std::size_t three = 0; three < changed_.size(); three += 3) {
    double* const x[3] = {changed_[three].data(), changed_[three + 1].data(),
                          changed_[three + 2].data()};
    factor_->solve_from(first, x);
  }
  Eigen::Matrix<double, 2 * kMaxConstraints, kParameters> crossed;
  crossed.setZero();
  for (int j = 0; j < kParameters; ++j) {
    const Column& changed = changed_[static_cast<std::size_t>(j)];
    for (int h = 0; h < count_; ++h) {
      const Columns& c = columns_[static_cast<std::size_t>(h)];
      crossed(2 * h, j) = dot(c.x[0], changed, first, rows);
      crossed(2 * h + 1, j) = dot(c.x[1], changed, first, rows);
    }
    slope[j] += dot(residual_, changed, first, rows) / data_scale_;
    for (int k = 0; k <= j; ++k) {
      curvature(j, k) = curvature(k, j) =
          dot(changed, changed_[static_cast<std::size_t>(k)], first, rows);
    }
  }
  curvature -= crossed.transpose() * fit.inverse * crossed;
  curvature /= data_scale_;
  const double bend_unit = Shape::kUnit[3] / Shape::kCurvature_per_m;
  const double soft_unit = Shape::kUnit[4] / Shape::kLnSoftness;
  slope[3] -= constraint.curvature_per_m / Shape::kCurvature_per_m * bend_unit;
  slope[4] -=
      std::log(constraint.softness_m / Shape::kUsualSoftness_m) / Shape::kLnSoftness * soft_unit;
  curvature(3, 3) += bend_unit * bend_unit;
  curvature(4, 4) += soft_unit * soft_unit;
  return slope.allFinite() && curvature.allFinite();
}

double ConstraintFit::refine(int index, int steps) noexcept {
  begin_refining(index, steps);
  while (refine_once()) {
  }
  return gain();
}

// columns_ and solution_ are of all constraints before and after.
bool ConstraintFit::refine_once() noexcept {
  if (steps_left_ == 0) {
    return false;
  }
  --steps_left_;
  const bool better = step_is_better();
  steps_left_ = better ? steps_left_ : 0;
  return steps_left_ > 0;
}

// @returns whether a step was made that is worth another one.
bool ConstraintFit::step_is_better() noexcept {
  const auto index = static_cast<std::size_t>(refined_);
  UnilateralConstraint& constraint = constraints_[index];
  Eigen::Matrix<double, kParameters, 1> slope;
  Eigen::Matrix<double, kParameters, kParameters> curvature;
  if (!derive(refined_, solution_, slope, curvature)) {
    return false;
  }
  Set set{};
  for (std::size_t h = 0; h < static_cast<std::size_t>(count_); ++h) {
    set[h] = h == index ? &trial_ : &columns_[h];
  }
  const double best = gain(solution_);
  for (int t = 0; t < kTriesOfAStep; ++t) {
    Eigen::Matrix<double, kParameters, kParameters> damped = curvature;
    damped.diagonal().array() += damping_ * (1.0 + curvature.diagonal().array().max(0.0));
    Eigen::Matrix<double, kParameters, 1> step = damped.ldlt().solve(slope);
    for (int j = 0; j < kParameters; ++j) {
      step[j] = std::clamp(step[j], -kLargestStep[j], kLargestStep[j]);
    }
    if (!step.allFinite()) {
      return false;
    }
    const UnilateralConstraint before = constraint;
    constraint = before.moved(step);
    solve_columns(constraint, trial_);
    const Solution tried = solve(set);
    const double improved = gain(tried) - best;
    if (improved > 0.0) {
      solution_ = tried;
      std::swap(columns_[index], trial_);
      damping_ = std::max(0.2 * damping_, 1e-6);
      return improved >= kConverged_nats;
    }
    constraint = before;
    damping_ *= 10.0;
  }
  return false;
}

// Whether field and constraints together explain all samples.
bool ConstraintFit::explains_all_samples() noexcept {
  const int rows = factor_->rows();
  double squares = -solution_.explained;
  for (int r = 0; r < rows; ++r) {
    squares += factor_->y(r) * factor_->y(r);
  }
  if (!solution_.pushes || !(squares < kExplainedScale * data_scale_ * rows)) {
    return false;
  }
  leave_over(solution_);
  factor_->solve_transposed(residual_.data());
  // The field leaves nugget alpha of a sample unexplained.
  const double limit = kExplainedDeviations * std::sqrt(data_scale_ / nugget_N2_);
  return std::all_of(residual_.begin(), residual_.begin() + rows,
                     [limit](double alpha) { return std::abs(alpha) < limit; });
}

// Brings columns_ and solution_ up to date with constraints_.
void ConstraintFit::refit() noexcept {
  Set set{};
  for (std::size_t h = 0; h < static_cast<std::size_t>(count_); ++h) {
    solve_columns(constraints_[h], columns_[h]);
    set[h] = &columns_[h];
  }
  solution_ = solve(set);
}

// Drops constraints that the samples no longer support.
void ConstraintFit::drop_unneeded() noexcept {
  for (int h = count_ - 1; h >= 0; --h) {
    Set others{};
    for (int i = 0; i < count_; ++i) {
      others[static_cast<std::size_t>(i)] =
          i == h ? nullptr : &columns_[static_cast<std::size_t>(i)];
    }
    const Solution without = solve(others);
    double& nats = gains_[static_cast<std::size_t>(h)];
    nats = solution_.gain - without.gain - constraints_[static_cast<std::size_t>(h)].prior_nats();
    if (solution_.pushes && nats >= kDrop_nats) {
      continue;
    }
    if (h + 1 < count_) {
      constraints_[static_cast<std::size_t>(h)] = constraints_[static_cast<std::size_t>(h) + 1];
      std::swap(columns_[static_cast<std::size_t>(h)], columns_[static_cast<std::size_t>(h) + 1]);
      gains_[static_cast<std::size_t>(h)] = gains_[static_cast<std::size_t>(h) + 1];
    }
    --count_;
    Set left{};
    for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
      left[i] = &columns_[i];
    }
    solution_ = solve(left);
  }
}

}  // namespace forcegrid::kriging
