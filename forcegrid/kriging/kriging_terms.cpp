// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_terms.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::kriging {
namespace {

// Independent of the data, so that the same samples are right for all fields.
FieldSettings by_position_only(FieldSettings settings) noexcept {
  settings.spacing.newtons = std::numeric_limits<double>::max();
  settings.surprise = std::numeric_limits<double>::max();
  return settings;
}

}  // namespace

template <int kTerms>
typename TermsField<kTerms>::SumField::Data TermsField<kTerms>::SumField::read_each(
    const Eigen::Vector3d& position_m) const noexcept {
  this->covariances_of_force(position_m, History::Zero(), this->x_);
  const auto rows = static_cast<std::size_t>(this->factor_.rows());
  Data data_N = Data::Zero();
  for (int j = 0; j <= kTerms; ++j) {
    const Column& weights = weights_[static_cast<std::size_t>(j)];
    for (int c = 0; c < 3; ++c) {
      const auto& covariances = this->x_.column[static_cast<std::size_t>(c)];
      for (std::size_t r = 0; r < rows; ++r) {
        data_N(c, j) += covariances[r] * weights[r];
      }
    }
  }
  return data_N;
}

template <int kTerms>
void TermsField<kTerms>::SumField::take_with(const Observation& o, const Terms& terms_N,
                                             const Factors& factors) noexcept {
  incoming_N_ = terms_N;
  factors_ = factors;
  Base::take(o);
}

// The data y = L^-1 R of each term, its weights L^-T y, and the weights of the sum.
template <int kTerms>
void TermsField<kTerms>::SumField::solve_weights() noexcept {
  static_assert(kTerms <= 6);
  if (this->placed_ != Base::kNone) {
    terms_N_[static_cast<std::size_t>(this->placed_)] = incoming_N_;
  }
  const auto rows = static_cast<std::size_t>(this->factor_.rows());
  std::size_t row = 0;
  for (int b = 0; b < this->block_count_; ++b) {
    const auto slot = static_cast<std::size_t>(this->blocks_[static_cast<std::size_t>(b)].slot);
    for (int i = 0; i < 3; ++i, ++row) {
      for (int j = 0; j < kTerms; ++j) {
        data_.column[static_cast<std::size_t>(j)][row] = terms_N_[slot](i, j);
      }
    }
  }
  this->factor_.solve(data_, kTerms);
  this->factor_.weights(weights_[0].data());
  std::copy_n(weights_[0].begin(), rows, this->alpha_.begin());
  for (std::size_t j = 0; j < static_cast<std::size_t>(kTerms); ++j) {
    Column& weights = weights_[j + 1];
    std::copy_n(data_.column[j].begin(), rows, weights.begin());
    this->factor_.solve_transposed(weights.data());
    const double factor = factors_[static_cast<int>(j)];
    for (std::size_t r = 0; r < rows; ++r) {
      this->alpha_[r] += factor * weights[r];
    }
  }
  squares_ = 0.0;
  for (std::size_t r = 0; r < rows; ++r) {
    double y = this->factor_.y(static_cast<int>(r));
    for (std::size_t j = 0; j < static_cast<std::size_t>(kTerms); ++j) {
      y += factors_[static_cast<int>(j)] * data_.column[j][r];
    }
    squares_ += y * y;
  }
}

template <int kTerms>
double TermsField<kTerms>::SumField::deviation_N(const Eigen::Vector3d& position_m,
                                                 const History& history) const noexcept {
  const double scale = squares_ / std::max(1, this->factor_.rows());
  return std::sqrt(this->variance_N2(position_m, history) * std::max(1.0, scale));
}

template <int kTerms>
TermsField<kTerms>::TermsField(const FieldSettings& settings) noexcept
    : field_(by_position_only(settings)) {}

template <int kTerms>
Innovation TermsField<kTerms>::take_with(const Observation& o, const Terms& terms_N) noexcept {
  Observation part = o;
  part.contact = 0;
  part.history.setZero();
  Innovation innovation;
  innovation.predicted = sample_count() > 0;
  const typename SumField::Data known_N = field_.read_each(o.position_m);
  const Eigen::Vector3d force_error_N = o.force_N - known_N.col(0);
  const Terms term_errors_N = terms_N - known_N.template rightCols<kTerms>();
  innovation.error_N = (force_error_N + term_errors_N * factors_).norm();
  if (innovation.predicted && !o.from_query) {
    learn(force_error_N, term_errors_N);
  }
  field_.take_with(part, terms_N, factors_);
  return innovation;
}

template <int kTerms>
void TermsField<kTerms>::learn(const Eigen::Vector3d& force_error_N,
                               const Terms& term_errors_N) noexcept {
  squares_N2_ = kKept * squares_N2_ + term_errors_N.transpose() * term_errors_N;
  products_N2_ = kKept * products_N2_ - term_errors_N.transpose() * force_error_N;
  Eigen::Matrix<double, kTerms, kTerms> regular_N2 = squares_N2_;
  regular_N2.diagonal().array() += kPrior_N2;
  const Factors best = regular_N2.ldlt().solve(products_N2_);
  if (best.allFinite()) {
    factors_ = limited(best.cwiseMax(-kMostFactor).cwiseMin(kMostFactor));
  }
}

template class TermsField<1>;
template class TermsField<kPathTerms>;

Innovation LagField::take(const Observation& observation) noexcept {
  if (!observation.has_rise && !observation.from_query) {
    return {};
  }
  return take_with(observation,
                   observation.from_query ? Terms(Terms::Zero()) : Terms(observation.rise_N));
}

Reading LagField::read(const Eigen::Vector3d& position_m,
                       const History& /*history*/) const noexcept {
  return read_field(position_m);
}

RelaxationField::Factors RelaxationField::limited(Factors factors) const noexcept {
  factors[0] = std::max(factors[0], 0.0);
  const double feedback = -factors.tail<kPathTerms - 1>().cwiseMin(0.0).sum();
  if (feedback > kMostFeedback) {
    for (int j = 1; j < kPathTerms; ++j) {
      factors[j] *= factors[j] < 0.0 ? kMostFeedback / feedback : 1.0;
    }
  }
  return factors;
}

Innovation RelaxationField::take(const Observation& observation) noexcept {
  return take_with(observation, observation.terms_N);
}

Reading RelaxationField::read(const Eigen::Vector3d& position_m,
                              const History& /*history*/) const noexcept {
  Reading reading = read_field(position_m);
  reading.force_N -= now_N_ * factors();
  return reading;
}

}  // namespace forcegrid::kriging
