#include "forcegrid/kriging/unilateral_constraint.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

// Prior deviations of the weights and shapes.
constexpr double kStiffness_N_per_m = 1000.0;
constexpr double kStiffening_N_per_m2 = 3e4;
constexpr double kCurvature_per_m = 40.0;
constexpr double kSoftness_m = 5e-5;
constexpr double kLnSoftness = 1.5;
constexpr double kHardest_m = 1e-5;
constexpr double kSoftest_m = 3e-3;

constexpr double kAccept_nats = 15.0;
constexpr double kDrop_nats = 3.0;
constexpr double kConverged_nats = 0.02;
constexpr double kExplainedScale = 3.0;       // of the data's scale before
constexpr double kExplainedDeviations = 4.0;  // of a sample's noise
constexpr double kSameDirection = 0.98;       // cosine
constexpr int kFailuresInARow = 4;
constexpr int kSamplesNeeded = 6;  // of those beyond a surface, never dropped

constexpr int kStepsOnSurprise = 10;
constexpr int kStepsOnSearch = 12;
constexpr int kStepsOnSample = 2;
constexpr int kTriesOfAStep = 3;

// One unit of each parameter of a shape, and the largest step.
constexpr double kUnit[5] = {0.1, 0.1, 1e-3, 10.0, 0.5};
constexpr double kLargestStep[5] = {3.0, 3.0, 2.0, 2.0, 1.5};
constexpr double kDifference = 1e-4;  // of a unit

constexpr int kGapsAgainstError = 10;
constexpr int kGapsBesides = 6;
constexpr double kNearError = 0.5;  // cosine
constexpr double kSearchedCurvatures_per_m[] = {-30.0, 20.0, 50.0};
constexpr double kStartingCurvatures_per_m[] = {-40.0, -15.0, 15.0, 40.0, 80.0};

double softplus(double s_m, double e_m) noexcept {
  const double ratio = s_m / e_m;
  if (ratio > 30.0) {
    return s_m;
  }
  return ratio < -30.0 ? 0.0 : e_m * std::log1p(std::exp(ratio));
}

double prior_nats(const UnilateralConstraint& constraint) noexcept {
  const double bent = constraint.curvature_per_m / kCurvature_per_m;
  const double soft = std::log(constraint.softness_m / kSoftness_m) / kLnSoftness;
  return 0.5 * (bent * bent + soft * soft);
}

// Two directions across a unit vector.
void tangents(const Vector3d& n, Vector3d& first, Vector3d& second) noexcept {
  int least = 0;
  n.cwiseAbs().minCoeff(&least);
  first = n.cross(Vector3d::Unit(least)).normalized();
  second = n.cross(first);
}

// A force that falls short along its own direction is an object that gives way (a cut,
// relaxation), not a wall.
bool gives_way(const Vector3d& expected_N, const Vector3d& force_N) noexcept {
  return force_N.norm() < expected_N.norm() &&
         force_N.dot(expected_N) > kSameDirection * force_N.norm() * expected_N.norm();
}

UnilateralConstraint moved(const UnilateralConstraint& constraint,
                           const Eigen::Matrix<double, 5, 1>& step) noexcept {
  UnilateralConstraint result = constraint;
  Vector3d first;
  Vector3d second;
  tangents(constraint.normal_W, first, second);
  result.normal_W =
      (constraint.normal_W + kUnit[0] * step[0] * first + kUnit[1] * step[1] * second).normalized();
  result.depth_m += kUnit[2] * step[2];
  result.curvature_per_m += kUnit[3] * step[3];
  result.softness_m =
      std::clamp(constraint.softness_m * std::exp(kUnit[4] * step[4]), kHardest_m, kSoftest_m);
  return result;
}

}  // namespace

UnilateralConstraint::At UnilateralConstraint::at(const Vector3d& position_W) const noexcept {
  const Vector3d from_surface_m = position_W - anchor_W + depth_m * normal_W;
  const Vector3d w = normal_W - curvature_per_m * from_surface_m;
  const double length = w.norm();
  // (1 - |w|) / c, which would lose all digits near c = 0.
  const double s_m =
      (2.0 * normal_W.dot(from_surface_m) - curvature_per_m * from_surface_m.squaredNorm()) /
      (1.0 + length);
  const bool has_direction = length > 1e-9;  // a ball's centre has none
  return {s_m, softplus(s_m, softness_m), has_direction ? Vector3d(w / length) : normal_W};
}

template <typename Real>
UnilateralConstraintField<Real>::UnilateralConstraintField(const FieldSettings& settings) noexcept
    : Base(settings) {}

template <typename Real>
Eigen::Vector2d UnilateralConstraintField<Real>::constraint_stiffness(int index) const noexcept {
  return {kStiffness_N_per_m * fit_.weight[2 * index],
          kStiffening_N_per_m2 * fit_.weight[2 * index + 1]};
}

template <typename Real>
void UnilateralConstraintField<Real>::set_constraints(
    std::span<const UnilateralConstraint> constraints) noexcept {
  constraint_count_ = static_cast<int>(std::min<std::size_t>(constraints.size(), kMaxConstraints));
  std::copy_n(constraints.begin(), constraint_count_, constraints_.begin());
  this->collapse();
}

template <typename Real>
Vector3d UnilateralConstraintField<Real>::push_N(int constraint,
                                                 const Vector3d& position_W) const noexcept {
  const UnilateralConstraint::At at =
      constraints_[static_cast<std::size_t>(constraint)].at(position_W);
  const Eigen::Vector2d k = constraint_stiffness(constraint);
  return std::min(0.0, (k[0] + k[1] * at.penetration_m) * at.penetration_m) * at.inward_W;
}

template <typename Real>
Reading UnilateralConstraintField<Real>::read(const Vector3d& position_m,
                                              const History& history) const noexcept {
  Reading reading = Base::read(position_m, history);
  for (int h = 0; h < constraint_count_; ++h) {
    reading.force_N += push_N(h, position_m + this->origin_W_);
  }
  return reading;
}

// Of m(phi) u, u = grad s: m' dphi/ds u u^T + m grad u, the curvature of a ball's distance being
// that of the ball through P.
template <typename Real>
Eigen::Matrix3d UnilateralConstraintField<Real>::push_stiffness_N_per_m(
    int constraint, const Vector3d& position_W) const noexcept {
  const UnilateralConstraint& shape = constraints_[static_cast<std::size_t>(constraint)];
  const UnilateralConstraint::At at = shape.at(position_W);
  const Eigen::Vector2d k = constraint_stiffness(constraint);
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

template <typename Real>
Eigen::Matrix3d UnilateralConstraintField<Real>::stiffness_N_per_m(
    const Vector3d& position_m, const History& history) const noexcept {
  Eigen::Matrix3d j = Base::stiffness_N_per_m(position_m, history);
  for (int h = 0; h < constraint_count_; ++h) {
    j += push_stiffness_N_per_m(h, position_m + this->origin_W_);
  }
  return j;
}

template <typename Real>
Vector3d UnilateralConstraintField<Real>::feature_force_N(const Stored& sample) const noexcept {
  Vector3d force_N = Vector3d::Zero();
  for (int h = 0; h < constraint_count_; ++h) {
    force_N += push_N(h, sample.position_m + sample.origin_W);
  }
  return force_N;
}

template <typename Real>
void UnilateralConstraintField<Real>::add_features(const Vector3d& p, const Vector3d& origin_W,
                                                   const typename Factor::Columns& x,
                                                   Vector3d& mean_N,
                                                   Eigen::Matrix3d& covariance_N2) const noexcept {
  if (constraint_count_ == 0) {
    return;
  }
  // What a constraint does at p beyond what the rows make of it there.
  Eigen::Matrix<double, 3, 2 * kMaxConstraints> left;
  left.setZero();
  for (int h = 0; h < constraint_count_; ++h) {
    const UnilateralConstraint::At at = constraints_[static_cast<std::size_t>(h)].at(p + origin_W);
    left.col(2 * h) = kStiffness_N_per_m * at.penetration_m * at.inward_W;
    left.col(2 * h + 1) = kStiffening_N_per_m2 * at.penetration_m * at.penetration_m * at.inward_W;
    for (int i = 0; i < 2; ++i) {
      const Column& column = columns_[static_cast<std::size_t>(h)].x[static_cast<std::size_t>(i)];
      for (std::size_t r = 0; r < static_cast<std::size_t>(this->factor_.rows()); ++r) {
        for (int c = 0; c < 3; ++c) {
          left(c, 2 * h + i) -= x.column[static_cast<std::size_t>(c)][r] * column[r];
        }
      }
    }
  }
  mean_N += left * fit_.weight;
  covariance_N2 += left * fit_.inverse * left.transpose();
}

template <typename Real>
bool UnilateralConstraintField<Real>::features_need(int slot) const noexcept {
  const Stored& s = this->stored_[static_cast<std::size_t>(slot)];
  for (int h = 0; h < constraint_count_; ++h) {
    const UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(h)];
    if (columns_[static_cast<std::size_t>(h)].active <= kSamplesNeeded &&
        constraint.at(s.position_m + s.origin_W).penetration_m > constraint.softness_m) {
      return true;
    }
  }
  return false;
}

template <typename Real>
Vector3d UnilateralConstraintField<Real>::position_of_block(int block) const noexcept {
  const Stored& s =
      this->stored_[static_cast<std::size_t>(this->blocks_[static_cast<std::size_t>(block)].slot)];
  return s.position_m + s.origin_W;
}

template <typename Real>
void UnilateralConstraintField<Real>::solve_columns(const UnilateralConstraint& constraint,
                                                    Columns& columns) const noexcept {
  columns.deepest_m = 0.0;
  columns.active = 0;
  int first = this->factor_.rows();
  std::size_t row = 0;
  for (int b = 0; b < this->block_count_; ++b, row += 3) {
    const UnilateralConstraint::At at = constraint.at(position_of_block(b));
    const double phi_m = at.penetration_m;
    for (int a = 0; a < 3; ++a) {
      const std::size_t r = row + static_cast<std::size_t>(a);
      columns.x[0][r] = kStiffness_N_per_m * phi_m * at.inward_W[a];
      columns.x[1][r] = kStiffening_N_per_m2 * phi_m * phi_m * at.inward_W[a];
      columns.x[2][r] = 0.0;
    }
    if (phi_m > 0.0) {
      first = std::min(first, static_cast<int>(row));
      columns.deepest_m = std::max(columns.deepest_m, phi_m);
      columns.active += phi_m > constraint.softness_m ? 1 : 0;
    }
  }
  double* const three[3] = {columns.x[0].data(), columns.x[1].data(), columns.x[2].data()};
  this->factor_.solve_from(first, three);
}

template <typename Real>
typename UnilateralConstraintField<Real>::Fit UnilateralConstraintField<Real>::fit(
    const Set& set) const noexcept {
  const auto rows = static_cast<std::size_t>(this->factor_.rows());
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
      seen[static_cast<int>(i)] += (*column[i])[r] * this->factor_.y(static_cast<int>(r));
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
  Fit fit;
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
        0.5 * fit.explained / scale_before_ - factor.matrixLLT().diagonal().array().log().sum();
    for (std::size_t h = 0; h < kMaxConstraints; ++h) {
      if (set[h] == nullptr) {
        continue;
      }
      const int i = 2 * static_cast<int>(h);
      const double k1 = kStiffness_N_per_m * fit.weight[i];
      const double k2 = kStiffening_N_per_m2 * fit.weight[i + 1];
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
template <typename Real>
void UnilateralConstraintField<Real>::leave_over(const Fit& fit) noexcept {
  for (std::size_t r = 0; r < static_cast<std::size_t>(this->factor_.rows()); ++r) {
    double left = this->factor_.y(static_cast<int>(r));
    for (int h = 0; h < constraint_count_; ++h) {
      const Columns& c = columns_[static_cast<std::size_t>(h)];
      left -= c.x[0][r] * fit.weight[2 * h] + c.x[1][r] * fit.weight[2 * h + 1];
    }
    residual_[r] = left;
  }
}

// Of all constraints, the priors of their shapes included.
template <typename Real>
double UnilateralConstraintField<Real>::gain(const Fit& fit) const noexcept {
  if (!fit.pushes) {
    return -std::numeric_limits<double>::infinity();
  }
  double nats = fit.gain;
  for (int h = 0; h < constraint_count_; ++h) {
    nats -= prior_nats(constraints_[static_cast<std::size_t>(h)]);
  }
  return nats;
}

// Slope and Gauss-Newton curvature of the gain in the parameters of a shape.
template <typename Real>
bool UnilateralConstraintField<Real>::derive(
    int index, const Fit& fit, Eigen::Matrix<double, kParameters, 1>& slope,
    Eigen::Matrix<double, kParameters, kParameters>& curvature) noexcept {
  const auto rows = static_cast<std::size_t>(this->factor_.rows());
  const UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  const int at = 2 * index;
  leave_over(fit);
  std::array<UnilateralConstraint, kParameters> shifted;
  for (int j = 0; j < kParameters; ++j) {
    Eigen::Matrix<double, kParameters, 1> step = Eigen::Matrix<double, kParameters, 1>::Zero();
    step[j] = kDifference;
    shifted[static_cast<std::size_t>(j)] = moved(constraint, step);
  }
  int first = static_cast<int>(rows);
  std::size_t row = 0;
  for (int b = 0; b < this->block_count_; ++b, row += 3) {
    const Vector3d position_W = position_of_block(b);
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
        derivatives_[j].x[0][r] = kStiffness_N_per_m * d1[a];
        derivatives_[j].x[1][r] = kStiffening_N_per_m2 * d2[a];
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
    this->factor_.solve_from(first, three);
    double rising = 0.0;
    double volume = 0.0;
    for (int h = 0; h < constraint_count_; ++h) {
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
    slope[static_cast<int>(j)] = rising / scale_before_ - volume;
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
  curvature /= scale_before_;
  const double bend_unit = kUnit[3] / kCurvature_per_m;
  const double soft_unit = kUnit[4] / kLnSoftness;
  slope[3] -= constraint.curvature_per_m / kCurvature_per_m * bend_unit;
  slope[4] -= std::log(constraint.softness_m / kSoftness_m) / kLnSoftness * soft_unit;
  curvature(3, 3) += bend_unit * bend_unit;
  curvature(4, 4) += soft_unit * soft_unit;
  return slope.allFinite() && curvature.allFinite();
}

// Improves one constraint with the others as they are; columns_ and fit_ are those of all
// constraints, and stay so. @returns the gain.
template <typename Real>
double UnilateralConstraintField<Real>::refine(int index, int steps) noexcept {
  UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  Columns& columns = columns_[static_cast<std::size_t>(index)];
  Set set{};
  for (std::size_t h = 0; h < static_cast<std::size_t>(constraint_count_); ++h) {
    set[h] = &columns_[h];
  }
  double best = gain(fit_);
  double damping = 0.03;
  for (int i = 0; i < steps; ++i) {
    Eigen::Matrix<double, kParameters, 1> slope;
    Eigen::Matrix<double, kParameters, kParameters> curvature;
    if (!derive(index, fit_, slope, curvature)) {
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
      constraint = moved(before, step);
      solve_columns(constraint, trial_);
      set[static_cast<std::size_t>(index)] = &trial_;
      const Fit tried = fit(set);
      set[static_cast<std::size_t>(index)] = &columns;
      const double nats = gain(tried);
      better = nats > best;
      if (better) {
        improved = nats - best;
        best = nats;
        fit_ = tried;
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

// Compares up to three new constraints beside those in use with the best so far, by their k1 alone.
template <typename Real>
void UnilateralConstraintField<Real>::weigh(std::span<const UnilateralConstraint> shapes,
                                            Candidate& best) noexcept {
  const auto rows = static_cast<std::size_t>(this->factor_.rows());
  int first = static_cast<int>(rows);
  std::size_t row = 0;
  for (int b = 0; b < this->block_count_; ++b, row += 3) {
    const Vector3d position_W = position_of_block(b);
    for (std::size_t t = 0; t < 3; ++t) {
      Vector3d push_N = Vector3d::Zero();
      if (t < shapes.size()) {
        const UnilateralConstraint::At at = shapes[t].at(position_W);
        push_N = kStiffness_N_per_m * at.penetration_m * at.inward_W;
      }
      for (int a = 0; a < 3; ++a) {
        trial_.x[t][row + static_cast<std::size_t>(a)] = push_N[a];
      }
      if (push_N != Vector3d::Zero()) {
        first = std::min(first, static_cast<int>(row));
      }
    }
  }
  double* const three[3] = {trial_.x[0].data(), trial_.x[1].data(), trial_.x[2].data()};
  this->factor_.solve_from(first, three);
  for (std::size_t t = 0; t < shapes.size(); ++t) {
    const Column& x = trial_.x[t];
    double own = 1.0;
    double seen = 0.0;
    Weights crossed = Weights::Zero();
    for (std::size_t r = static_cast<std::size_t>(first); r < rows; ++r) {
      own += x[r] * x[r];
      seen += x[r] * residual_[r];
      for (int h = 0; h < constraint_count_; ++h) {
        const Columns& c = columns_[static_cast<std::size_t>(h)];
        crossed[2 * h] += c.x[0][r] * x[r];
        crossed[2 * h + 1] += c.x[1][r] * x[r];
      }
    }
    own -= crossed.dot(fit_.inverse * crossed);
    const double nats = 0.5 * seen * seen / (own * scale_before_) - 0.5 * std::log(own);
    if (seen < 0.0 && own > 0.0 && nats > best.nats) {
      best = {shapes[t], nats};
    }
  }
}

// Weighs surfaces behind and parallel to `through`: some in each of the first gaps between samples.
template <typename Real>
void UnilateralConstraintField<Real>::weigh_behind(const UnilateralConstraint& through, int gaps,
                                                   std::span<const double> parts,
                                                   Candidate& best) noexcept {
  std::array<double, Base::kMaxSamplesHeld> behind_m{};
  int behind = 0;
  for (const Stored& s : this->stored_) {
    const double depth_m = s.used ? through.at(s.position_m + s.origin_W).depth_m : 0.0;
    if (depth_m < 0.0) {
      behind_m[static_cast<std::size_t>(behind++)] = -depth_m;
    }
  }
  std::sort(behind_m.begin(), behind_m.begin() + behind);
  std::array<UnilateralConstraint, 3> shapes;
  std::size_t pending = 0;
  double from_m = 0.0;
  for (int i = 0; i < std::min(gaps, behind); ++i) {
    const double to_m = behind_m[static_cast<std::size_t>(i)];
    for (const double part : parts) {
      shapes[pending] = through;
      shapes[pending].depth_m = from_m + part * (to_m - from_m);
      if (++pending == shapes.size()) {
        weigh(shapes, best);
        pending = 0;
      }
    }
    from_m = to_m;
  }
  weigh(std::span(shapes).first(pending), best);
}

// New constraints beside those in use that could explain the newest sample: the best plane and the
// best ball against the innovation, and the best plane across a lattice direction. @returns how
// many.
template <typename Real>
int UnilateralConstraintField<Real>::search(const Observation& o, const Vector3d& error_N,
                                            Candidates& found) noexcept {
  leave_over(fit_);
  int count = 0;
  Candidate best;
  const auto keep = [&] {
    if (best.nats > 0.0) {
      found[static_cast<std::size_t>(count)] = best.constraint;
      found[static_cast<std::size_t>(count++)].softness_m = kSoftness_m;
    }
    best = {};
  };
  UnilateralConstraint through;
  through.anchor_W = o.position_m + o.origin_W;
  through.normal_W = -error_N.normalized();
  through.softness_m = kHardest_m;
  const Vector3d against = through.normal_W;
  constexpr double kQuarters[] = {0.25, 0.75};
  constexpr double kMiddle[] = {0.5};
  weigh_behind(through, kGapsAgainstError, kQuarters, best);
  keep();
  for (const double curvature_per_m : kSearchedCurvatures_per_m) {
    through.curvature_per_m = curvature_per_m;
    weigh_behind(through, kGapsBesides, kQuarters, best);
  }
  keep();
  through.curvature_per_m = 0.0;
  for (int i = 0; i < 27; ++i) {
    const Vector3d lattice(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    if (lattice.dot(against) > kNearError * lattice.norm()) {
      through.normal_W = lattice.normalized();
      weigh_behind(through, kGapsBesides, kMiddle, best);
    }
  }
  keep();
  return count;
}

// Whether field and constraints say what all samples say.
template <typename Real>
bool UnilateralConstraintField<Real>::explained_by(const Fit& fit) noexcept {
  const int rows = this->factor_.rows();
  double squares = -fit.explained;
  for (int r = 0; r < rows; ++r) {
    squares += this->factor_.y(r) * this->factor_.y(r);
  }
  if (!fit.pushes || !(squares < kExplainedScale * scale_before_ * rows)) {
    return false;
  }
  leave_over(fit);
  this->factor_.solve_transposed(residual_.data());
  // What the field leaves of a sample is nugget alpha.
  const double limit = kExplainedDeviations * std::sqrt(scale_before_ / this->settings_.nugget_N2);
  return std::all_of(residual_.begin(), residual_.begin() + rows,
                     [limit](double alpha) { return std::abs(alpha) < limit; });
}

// Brings columns_ and fit_ up to date with constraints_.
template <typename Real>
void UnilateralConstraintField<Real>::refit() noexcept {
  Set set{};
  for (std::size_t h = 0; h < static_cast<std::size_t>(constraint_count_); ++h) {
    solve_columns(constraints_[h], columns_[h]);
    set[h] = &columns_[h];
  }
  fit_ = fit(set);
}

// Refines a constraint from other curvatures, too: from a plane there may be no way to a ball.
template <typename Real>
void UnilateralConstraintField<Real>::refine_anew(int index) noexcept {
  UnilateralConstraint& constraint = constraints_[static_cast<std::size_t>(index)];
  const UnilateralConstraint before = constraint;
  UnilateralConstraint best = constraint;
  refit();
  double best_nats = gain(fit_);
  for (const double curvature_per_m : kStartingCurvatures_per_m) {
    constraint = before;
    constraint.curvature_per_m = curvature_per_m;
    constraint.softness_m = kSoftness_m;
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

// Looks for constraints that explain the newest sample, which is the factor's last.
template <typename Real>
bool UnilateralConstraintField<Real>::pursue(const Observation& o,
                                             const Vector3d& error_N) noexcept {
  refit();
  if (constraint_count_ > 0) {
    for (int h = 0; h < constraint_count_; ++h) {
      refine(h, kStepsOnSurprise);
    }
    if (explained_by(fit_)) {
      return true;
    }
    for (int h = 0; h < constraint_count_; ++h) {
      refine_anew(h);
    }
    if (explained_by(fit_)) {
      return true;
    }
  }
  if (gives_way(o.force_N - error_N, o.force_N)) {
    return false;
  }
  const std::array<UnilateralConstraint, kMaxConstraints> refined = constraints_;
  const int refined_count = constraint_count_;
  std::array<UnilateralConstraint, kMaxConstraints> best = constraints_;
  int best_count = 0;
  double best_nats = std::max(0.0, gain(fit_)) + kAccept_nats;
  const bool replacing = refined_count == kMaxConstraints;
  for (int replaced = 0; replaced < (replacing ? kMaxConstraints : 1); ++replaced) {
    std::array<UnilateralConstraint, kMaxConstraints> others = refined;
    int count = refined_count;
    if (replacing) {
      others[static_cast<std::size_t>(replaced)] = refined[kMaxConstraints - 1];
      --count;
    }
    constraints_ = others;
    constraint_count_ = count;
    refit();
    Candidates found;
    const int candidates = search(o, error_N, found);
    for (int c = 0; c < candidates; ++c) {
      constraints_ = others;
      constraints_[static_cast<std::size_t>(count)] = found[static_cast<std::size_t>(c)];
      constraint_count_ = count + 1;
      refit();
      for (int h = count; h >= 0; --h) {
        refine(h, kStepsOnSearch);
      }
      const double nats = gain(fit_);
      if (nats > best_nats) {
        best_nats = nats;
        best = constraints_;
        best_count = constraint_count_;
      }
    }
  }
  constraints_ = best;
  constraint_count_ = best_count;
  return best_count > 0;
}

template <typename Real>
bool UnilateralConstraintField<Real>::explain(const Observation& o,
                                              const Vector3d& error_N) noexcept {
  // What is a surprise for one sample after the other is no wall.
  if (failures_ >= kFailuresInARow && failures_ % kFailuresInARow != 0) {
    ++failures_;
    return false;
  }
  std::array<double, Base::kMaxSamplesHeld> doubts_N2;
  bool doubted = false;
  for (std::size_t i = 0; i < doubts_N2.size(); ++i) {
    Stored& s = this->stored_[i];
    doubts_N2[i] = s.doubt_N2;
    doubted = doubted || (s.used && s.doubt_N2 > 0.0);
    s.doubt_N2 = 0.0;
  }
  if (doubted) {
    this->factorise();
  }
  const std::array<UnilateralConstraint, kMaxConstraints> constraints = constraints_;
  const int count = constraint_count_;
  const int slot = this->place(o);
  this->append_force(slot, false);
  const bool explained = pursue(o, error_N);
  this->remove_sample(slot);
  if (explained) {
    return true;
  }
  ++failures_;
  constraints_ = constraints;
  constraint_count_ = count;
  for (std::size_t i = 0; i < doubts_N2.size(); ++i) {
    this->stored_[i].doubt_N2 = doubts_N2[i];
  }
  return false;
}

template <typename Real>
Innovation UnilateralConstraintField<Real>::take(const Observation& o) noexcept {
  refinements_due_ = kStepsOnSample;
  const Innovation innovation = Base::take(o);
  if (!innovation.surprised) {
    failures_ = 0;
    scale_before_ = this->data_scale();
  }
  return innovation;
}

template <typename Real>
void UnilateralConstraintField<Real>::solve_weights() noexcept {
  refit();
  for (int h = 0; h < constraint_count_; ++h) {
    refine(h, refinements_due_);
  }
  refinements_due_ = 0;
  drop_unneeded();
  leave_over(fit_);
  std::copy_n(residual_.begin(), this->factor_.rows(), this->alpha_.begin());
  this->factor_.solve_transposed(this->alpha_.data());
}

// Drops constraints that the samples don't speak for any more.
template <typename Real>
void UnilateralConstraintField<Real>::drop_unneeded() noexcept {
  for (int h = constraint_count_ - 1; h >= 0; --h) {
    Set others{};
    for (int i = 0; i < constraint_count_; ++i) {
      others[static_cast<std::size_t>(i)] =
          i == h ? nullptr : &columns_[static_cast<std::size_t>(i)];
    }
    const Fit without = fit(others);
    double& nats = gains_[static_cast<std::size_t>(h)];
    nats = fit_.gain - without.gain - prior_nats(constraints_[static_cast<std::size_t>(h)]);
    if (fit_.pushes && nats >= kDrop_nats) {
      continue;
    }
    if (h + 1 < constraint_count_) {
      constraints_[static_cast<std::size_t>(h)] = constraints_[static_cast<std::size_t>(h) + 1];
      std::swap(columns_[static_cast<std::size_t>(h)], columns_[static_cast<std::size_t>(h) + 1]);
      gains_[static_cast<std::size_t>(h)] = gains_[static_cast<std::size_t>(h) + 1];
    }
    --constraint_count_;
    Set left{};
    for (std::size_t i = 0; i < static_cast<std::size_t>(constraint_count_); ++i) {
      left[i] = &columns_[i];
    }
    fit_ = fit(left);
  }
}

template class UnilateralConstraintField<float>;
template class UnilateralConstraintField<double>;

}  // namespace forcegrid::kriging
