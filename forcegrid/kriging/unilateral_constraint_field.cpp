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
  refined_ = kNoneRefined;
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
  for (int h = 0; h < wall_count_; ++h) {
    const Wall& wall = walls_[static_cast<std::size_t>(h)];
    reading.force_N +=
        ConstraintFit::push_N(wall.shape, wall.stiffness, position_m + this->origin_W_);
  }
  return reading;
}

template <typename Real>
Eigen::Matrix3d UnilateralConstraintField<Real>::stiffness_N_per_m(
    const Vector3d& position_m, const History& history) const noexcept {
  Eigen::Matrix3d j = Base::stiffness_N_per_m(position_m, history);
  for (int h = 0; h < wall_count_; ++h) {
    const Wall& wall = walls_[static_cast<std::size_t>(h)];
    j += ConstraintFit::push_stiffness_N_per_m(wall.shape, wall.stiffness,
                                               position_m + this->origin_W_);
  }
  return j;
}

template <typename Real>
Vector3d UnilateralConstraintField<Real>::feature_force_N(const Stored& sample) const noexcept {
  Vector3d force_N = Vector3d::Zero();
  for (int h = 0; h < wall_count_; ++h) {
    const Wall& wall = walls_[static_cast<std::size_t>(h)];
    force_N +=
        ConstraintFit::push_N(wall.shape, wall.stiffness, sample.position_m + sample.origin_W);
  }
  return force_N;
}

template <typename Real>
void UnilateralConstraintField<Real>::add_features(const Vector3d& p, const Vector3d& origin_W,
                                                   const typename Factor::Columns& x,
                                                   Vector3d& mean_N,
                                                   Eigen::Matrix3d& covariance_N2) const noexcept {
  if (seeking_ == Seeking::kNothing) {  // else the fit belongs to the search
    fit_.add_features(p + origin_W, this->factor_.rows(), x, mean_N, covariance_N2);
  }
}

template <typename Real>
bool UnilateralConstraintField<Real>::features_need(int slot) const noexcept {
  const Stored& s = this->stored_[static_cast<std::size_t>(slot)];
  return fit_.rests_on(s.position_m + s.origin_W);
}

// Not if every sample is a surprise: then the cause is not a wall.
template <typename Real>
bool UnilateralConstraintField<Real>::seeks_explanation(const Observation& o,
                                                        const Vector3d& error_N,
                                                        const Innovation& innovation) noexcept {
  if (failures_ >= kFailuresInARow && failures_ % kFailuresInARow != 0) {
    ++failures_;
    return false;
  }
  sought_ = o;
  error_N_ = error_N;
  taken_ = innovation;
  seeking_ = Seeking::kBegins;
  return true;
}

// The search needs the factor of the samples without their doubts.
template <typename Real>
void UnilateralConstraintField<Real>::leave_doubts_out() noexcept {
  bool doubted = false;
  for (std::size_t i = 0; i < doubts_N2_.size(); ++i) {
    Stored& s = this->stored_[i];
    doubts_N2_[i] = s.doubt_N2;
    doubted = doubted || (s.used && s.doubt_N2 > 0.0);
    s.doubt_N2 = 0.0;
  }
  if (doubted) {
    this->begin_factor();
  }
  seeking_ = Seeking::kFactorises;
}

template <typename Real>
void UnilateralConstraintField<Real>::begin_search() noexcept {
  slot_ = this->place(sought_);
  this->append_force(slot_, false);
  set_rows();
  search_.begin(sought_, error_N_);
  seeking_ = Seeking::kSearches;
}

// The fit has those that a search tried.
template <typename Real>
void UnilateralConstraintField<Real>::restore_walls() noexcept {
  std::array<UnilateralConstraint, ConstraintFit::kMaxConstraints> shapes;
  std::transform(walls_.begin(), walls_.end(), shapes.begin(),
                 [](const Wall& wall) { return wall.shape; });
  fit_.set_constraints(shapes, wall_count_);
}

template <typename Real>
void UnilateralConstraintField<Real>::end_search() noexcept {
  seeking_ = Seeking::kNothing;
  this->remove_sample(slot_);
  taken_.explained = search_.found();
  if (!taken_.explained) {
    ++failures_;
    restore_walls();
    for (std::size_t i = 0; i < doubts_N2_.size(); ++i) {
      this->stored_[i].doubt_N2 = doubts_N2_[i];
    }
  }
  this->finish_surprise(sought_, error_N_, taken_);
  while (taken_.explained && refine_once()) {  // a wall cannot wait
  }
}

template <typename Real>
bool UnilateralConstraintField<Real>::prepare() noexcept {
  if (seeking_ == Seeking::kNothing) {
    if (this->blocks_due_ == 0) {
      return refine_once();
    }
    Base::prepare();
    Base::prepare();  // twice as much at once: a wall cannot wait
    return true;
  }
  if (seeking_ == Seeking::kBegins) {
    leave_doubts_out();
  }
  if (seeking_ == Seeking::kFactorises) {
    if (this->blocks_due_ > 0) {
      this->append_some();
      return true;
    }
    begin_search();
  }
  if (!search_.step(fit_)) {
    end_search();
  }
  return true;
}

// One Newton step of one constraint. @returns false if none was due.
template <typename Real>
bool UnilateralConstraintField<Real>::refine_once() noexcept {
  if (refined_ == kNoneRefined) {
    return false;
  }
  if (!fit_.refine_once() && ++refined_ < fit_.count()) {
    fit_.begin_refining(refined_, kStepsOnSample);
  }
  if (refined_ == fit_.count()) {
    refined_ = kNoneRefined;
    this->collapse();
    update_data_scale();
  }
  return true;
}

// The scale of samples that were no surprise, with constraints that have been refined to them.
template <typename Real>
void UnilateralConstraintField<Real>::update_data_scale() noexcept {
  if (scale_due_) {
    fit_.set_data_scale(this->data_scale());
  }
  scale_due_ = false;
}

template <typename Real>
bool UnilateralConstraintField<Real>::begin_with(
    std::span<const Observation> observations) noexcept {
  refines_ = false;
  refined_ = kNoneRefined;
  scale_due_ = false;
  if (seeking_ != Seeking::kNothing) {
    seeking_ = Seeking::kNothing;
    restore_walls();
  }
  return Base::begin_with(observations);
}

template <typename Real>
Innovation UnilateralConstraintField<Real>::take(const Observation& o) noexcept {
  this->finish();
  refines_ = true;
  const Innovation innovation = Base::take(o);
  if (!innovation.surprised) {
    failures_ = 0;
    scale_due_ = true;
    if (refined_ == kNoneRefined) {
      update_data_scale();
    }
  }
  return innovation;
}

template <typename Real>
void UnilateralConstraintField<Real>::solve_weights() noexcept {
  set_rows();
  fit_.refit();
  if (refines_ && fit_.count() > 0) {
    refined_ = 0;
    fit_.begin_refining(refined_, kStepsOnSample);
  } else {
    fit_.drop_unneeded();
  }
  refines_ = false;
  wall_count_ = fit_.count();
  for (int h = 0; h < wall_count_; ++h) {
    walls_[static_cast<std::size_t>(h)] = {fit_.constraints()[static_cast<std::size_t>(h)],
                                           fit_.stiffness(h)};
  }
  fit_.update_residual();
  std::copy_n(fit_.residual().begin(), this->factor_.rows(), this->alpha_.begin());
  this->factor_.solve_transposed(this->alpha_.data());
}

template class UnilateralConstraintField<float>;
template class UnilateralConstraintField<double>;

}  // namespace forcegrid::kriging
