// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/unilateral_constraint_field.h"

#include <algorithm>
#include <array>
#include <type_traits>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

constexpr int kFailuresInARow = 4;
constexpr int kStepsOnSample = 2;

}  // namespace

template <typename Real>
UnilateralConstraintField<Real>::UnilateralConstraintField(const FieldSettings& settings) noexcept
    : Base(settings), fit_(settings.nugget_N2) {
  static_assert(std::is_same_v<Factor, ConstraintFit::Factor>);
}

template <typename Real>
void UnilateralConstraintField<Real>::set_constraints(
    std::span<const UnilateralConstraint> constraints) noexcept {
  fit_.set_constraints(constraints);
  this->collapse();
}

template <typename Real>
void UnilateralConstraintField<Real>::set_rows() noexcept {
  fit_.set_rows(this->factor_, this->block_count_, [this](int block) {
    const auto slot = this->blocks_[static_cast<std::size_t>(block)].slot;
    const Stored& s = this->stored_[static_cast<std::size_t>(slot)];
    return Vector3d(s.position_m + s.origin_W);
  });
}

template <typename Real>
Reading UnilateralConstraintField<Real>::read(const Vector3d& position_m,
                                              const History& history) const noexcept {
  Reading reading = Base::read(position_m, history);
  for (int h = 0; h < fit_.count(); ++h) {
    reading.force_N += fit_.push_N(h, position_m + this->origin_W_);
  }
  return reading;
}

template <typename Real>
Eigen::Matrix3d UnilateralConstraintField<Real>::stiffness_N_per_m(
    const Vector3d& position_m, const History& history) const noexcept {
  Eigen::Matrix3d j = Base::stiffness_N_per_m(position_m, history);
  for (int h = 0; h < fit_.count(); ++h) {
    j += fit_.push_stiffness_N_per_m(h, position_m + this->origin_W_);
  }
  return j;
}

template <typename Real>
Vector3d UnilateralConstraintField<Real>::feature_force_N(const Stored& sample) const noexcept {
  Vector3d force_N = Vector3d::Zero();
  for (int h = 0; h < fit_.count(); ++h) {
    force_N += fit_.push_N(h, sample.position_m + sample.origin_W);
  }
  return force_N;
}

template <typename Real>
void UnilateralConstraintField<Real>::add_features(const Vector3d& p, const Vector3d& origin_W,
                                                   const typename Factor::Columns& x,
                                                   Vector3d& mean_N,
                                                   Eigen::Matrix3d& covariance_N2) const noexcept {
  fit_.add_features(p + origin_W, this->factor_.rows(), x, mean_N, covariance_N2);
}

template <typename Real>
bool UnilateralConstraintField<Real>::features_need(int slot) const noexcept {
  const Stored& s = this->stored_[static_cast<std::size_t>(slot)];
  return fit_.rests_on(s.position_m + s.origin_W);
}

template <typename Real>
bool UnilateralConstraintField<Real>::explain(const Observation& o,
                                              const Vector3d& error_N) noexcept {
  // If every sample is a surprise, the cause is not a wall.
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
  const ConstraintFit::Shapes constraints = fit_.constraints();
  const int count = fit_.count();
  const int slot = this->place(o);
  this->append_force(slot, false);
  set_rows();
  const bool explained = search_.explain(fit_, o, error_N);
  this->remove_sample(slot);
  if (explained) {
    return true;
  }
  ++failures_;
  fit_.set_constraints(constraints, count);
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
    fit_.set_data_scale(this->data_scale());
  }
  return innovation;
}

template <typename Real>
void UnilateralConstraintField<Real>::solve_weights() noexcept {
  set_rows();
  fit_.refit();
  for (int h = 0; h < fit_.count(); ++h) {
    fit_.refine(h, refinements_due_);
  }
  refinements_due_ = 0;
  fit_.drop_unneeded();
  fit_.update_residual();
  std::copy_n(fit_.residual().begin(), this->factor_.rows(), this->alpha_.begin());
  this->factor_.solve_transposed(this->alpha_.data());
}

template class UnilateralConstraintField<float>;
template class UnilateralConstraintField<double>;

}  // namespace forcegrid::kriging
