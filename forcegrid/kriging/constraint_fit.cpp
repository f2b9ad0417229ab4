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
constexpr double kStartingCurvatures_per_m[] = {-40.0, -15.0, 15.0, 40.0, 80.0};

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

Vector3d ConstraintFit::push_N(int constraint, const Vector3d& position_W) const noexcept {
  const UnilateralConstraint::At at =
      constraints_[static_cast<std::size_t>(constraint)].at(position_W);
  const Eigen::Vector2d k = stiffness(constraint);
  return std::min(0.0, (k[0] + k[1] * at.penetration_m) * at.penetration_m) * at.inward_W;
}

// Derivative of m(phi) u, u = grad s: m' dphi/ds u u^T + m grad u. The curvature of a ball's
// distance is that of the ball through P.
Eigen::Matrix3d ConstraintFit::push_stiffness_N_per_m(int constraint,
                                                      const Vector3d& position_W) const noexcept {
  const UnilateralConstraint& shape = constraints_[static_cast<std::size_t>(constraint)];
  const UnilateralConstraint::At at = shape.at(position_W);
  const Eigen::Vector2d k = stiffness(constraint);
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
      for (std::size_t r = 0; r < static_cast<std::size_t>(rows); ++r) {
        for (int c = 0; c < 3; ++c) {
          left(c, 2 * h + i) -= x.column[static_cast<std::size_t>(c)][r] * column[r];
        }
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
  const auto rows = static_cast<std::size_t>(factor_->rows());
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
    for (std::size_t r = 0; r < rows; ++r) {
      seen[static_cast<int>(i)] += (*column[i])[r] * factor_->y(static_cast<int>(r));
    }
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = 0.0;
      for (std::size_t r = 0; used[j] && r < rows; ++r) {
        sum += (*column[i])[r] * (*column[j])[r];
      }
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
  const auto rows = static_cast<std::size_t>(factor_->rows());
  const UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  const int at = 2 * index;
  leave_over(fit);
  std::array<UnilateralConstraint, kParameters> shifted;
  for (int j = 0; j < kParameters; ++j) {
    Eigen::Matrix<double, kParameters, 1> step = Eigen::Matrix<double, kParameters, 1>::Zero();
    step[j] = kDifference;
    shifted[static_cast<std::size_t>(j)] = constraint.moved(step);
  }
  int first = static_cast<int>(rows);
  std::size_t row = 0;
  for (int b = 0; b < position_count_; ++b, row += 3) {
    const Vector3d position_W = positions_W_[static_cast<std::size_t>(b)];
    const UnilateralConstraint::At here = constraint.at(position_W);
    for (std::size_t j = 0; j < kParameters; ++j) {
      const UnilateralConstraint::At there = shifted[j].at(position_W);
      const Vector3d d1 =
          (there.penetration_m * there.inward_W - here.penetration_m * here.inward_W) / kDifference;
      const Vector3d d2 = (there.penetration_m * there.penetration_m * there.inward_W -
                           here.penetration_m * here.penetration_m * here.inward_W) /
                          kDifference;
      for (int a = 0; a < 3; ++a) {
        const std::size_t r = row + static_cast<std::size_t>(a);
        derivatives_[j].x[0][r] = Shape::kStiffness_N_per_m * d1[a];
        derivatives_[j].x[1][r] = Shape::kStiffening_N_per_m2 * d2[a];
        derivatives_[j].x[2][r] = 0.0;
      }
      if (there.penetration_m > 0.0 || here.penetration_m > 0.0) {
        first = std::min(first, static_cast<int>(row));
      }
    }
  }
  if (first >= static_cast<int>(rows)) {
    return false;
  }
  Eigen::Matrix<double, 2 * kMaxConstraints, kParameters> crossed;
  crossed.setZero();
  for (std::size_t j = 0; j < kParameters; ++j) {
    Columns& d = derivatives_[j];
    double* const three[3] = {d.x[0].data(), d.x[1].data(), d.x[2].data()};
    factor_->solve_from(first, three);
    double rising = 0.0;
    double volume = 0.0;
    for (int h = 0; h < count_; ++h) {
      for (int i = 0; i < 2; ++i) {
        const Column& column = columns_[static_cast<std::size_t>(h)].x[static_cast<std::size_t>(i)];
        double with_first = 0.0;
        double with_second = 0.0;
        for (std::size_t r = 0; r < rows; ++r) {
          with_first += column[r] * d.x[0][r];
          with_second += column[r] * d.x[1][r];
        }
        volume +=
            fit.inverse(at, 2 * h + i) * with_first + fit.inverse(at + 1, 2 * h + i) * with_second;
        crossed(2 * h + i, static_cast<int>(j)) =
            with_first * fit.weight[at] + with_second * fit.weight[at + 1];
      }
    }
    // From here on x[2] is the derivative of X beta.
    for (std::size_t r = 0; r < rows; ++r) {
      d.x[2][r] = d.x[0][r] * fit.weight[at] + d.x[1][r] * fit.weight[at + 1];
      rising += residual_[r] * d.x[2][r];
    }
    slope[static_cast<int>(j)] = rising / data_scale_ - volume;
  }
  for (std::size_t j = 0; j < kParameters; ++j) {
    for (std::size_t k = 0; k <= j; ++k) {
      double sum = 0.0;
      for (std::size_t r = 0; r < rows; ++r) {
        sum += derivatives_[j].x[2][r] * derivatives_[k].x[2][r];
      }
      curvature(static_cast<int>(j), static_cast<int>(k)) = sum;
      curvature(static_cast<int>(k), static_cast<int>(j)) = sum;
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

// Improves one constraint while the others stay as they are. columns_ and solution_ are of all
// constraints before and after. @returns the gain.
double ConstraintFit::refine(int index, int steps) noexcept {
  UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  Columns& columns = columns_[static_cast<std::size_t>(index)];
  Set set{};
  for (std::size_t h = 0; h < static_cast<std::size_t>(count_); ++h) {
    set[h] = &columns_[h];
  }
  double best = gain(solution_);
  double damping = 0.03;
  for (int i = 0; i < steps; ++i) {
    Eigen::Matrix<double, kParameters, 1> slope;
    Eigen::Matrix<double, kParameters, kParameters> curvature;
    if (!derive(index, solution_, slope, curvature)) {
      break;
    }
    bool better = false;
    double improved = 0.0;
    for (int t = 0; t < kTriesOfAStep && !better; ++t) {
      Eigen::Matrix<double, kParameters, kParameters> damped = curvature;
      damped.diagonal().array() += damping * (1.0 + curvature.diagonal().array().max(0.0));
      Eigen::Matrix<double, kParameters, 1> step = damped.ldlt().solve(slope);
      for (int j = 0; j < kParameters; ++j) {
        step[j] = std::clamp(step[j], -kLargestStep[j], kLargestStep[j]);
      }
      if (!step.allFinite()) {
        break;
      }
      const UnilateralConstraint before = constraint;
      constraint = before.moved(step);
      solve_columns(constraint, trial_);
      set[static_cast<std::size_t>(index)] = &trial_;
      const Solution tried = solve(set);
      set[static_cast<std::size_t>(index)] = &columns;
      const double nats = gain(tried);
      better = nats > best;
      if (better) {
        improved = nats - best;
        best = nats;
        solution_ = tried;
        std::swap(columns, trial_);
        damping = std::max(0.2 * damping, 1e-6);
      } else {
        constraint = before;
        damping *= 10.0;
      }
    }
    if (!better || improved < kConverged_nats) {
      break;
    }
  }
  return best;
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

// Refines a constraint from other curvatures too: a plane may have no descent path to a ball.
void ConstraintFit::refine_anew(int index) noexcept {
  UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  const UnilateralConstraint before = constraint;
  UnilateralConstraint best = constraint;
  refit();
  double best_nats = gain(solution_);
  for (const double curvature_per_m : kStartingCurvatures_per_m) {
    constraint = before;
    constraint.curvature_per_m = curvature_per_m;
    constraint.softness_m = Shape::kUsualSoftness_m;
    refit();
    const double nats = refine(index, kStepsOnSurprise);
    if (nats > best_nats) {
      best_nats = nats;
      best = constraint;
    }
  }
  constraint = best;
  refit();
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
