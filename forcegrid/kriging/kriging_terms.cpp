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
double TermsField<kTerms>::SumField::learn_from(const Observation& o) noexcept {
  Base::take(o);
  return error_N_;
}

template <int kTerms>
void TermsField<kTerms>::SumField::predicted(const Observation& o, const Columns& x) noexcept {
  const Eigen::Vector3d force_error_N = o.force_N - this->factor_.template mean<3>(x);
  const Terms term_errors_N = o.terms_N.template leftCols<kTerms>() - this->factor_.more_means(x);
  error_N_ = (force_error_N + term_errors_N * factors_).norm();
  if (this->sample_count() > 0 && !o.from_query) {
    learn(force_error_N, term_errors_N);
  }
}

template <int kTerms>
void TermsField<kTerms>::SumField::learn(const Eigen::Vector3d& force_error_N,
                                         const Terms& term_errors_N) noexcept {
  squares_N2_ = kKept * squares_N2_ + term_errors_N.transpose() * term_errors_N;
  products_N2_ = kKept * products_N2_ - term_errors_N.transpose() * force_error_N;
  Eigen::Matrix<double, kTerms, kTerms> regular_N2 = squares_N2_;
  regular_N2.diagonal().array() += kPrior_N2;
  const Factors best = regular_N2.ldlt().solve(products_N2_);
  if (best.allFinite()) {
    factors_ = owner_.limited(best.cwiseMax(-kMostFactor).cwiseMin(kMostFactor));
  }
}

// The weights of the sum.
template <int kTerms>
void TermsField<kTerms>::SumField::solve_weights() noexcept {
  this->factor_.sum_of_data(factors_, this->alpha_.data());
  this->factor_.solve_transposed(this->alpha_.data());
}

template <int kTerms>
double TermsField<kTerms>::SumField::deviation_N(const Eigen::Vector3d& position_m,
                                                 const History& history) const noexcept {
  std::array<double, Base::Factor::kStride> y;
  this->factor_.sum_of_data(factors_, y.data());
  const int rows = this->factor_.rows();
  double squares = 0.0;
  for (std::size_t r = 0; r < static_cast<std::size_t>(rows); ++r) {
    squares += y[r] * y[r];
  }
  return std::sqrt(this->variance_N2(position_m, history) *
                   std::max(1.0, squares / std::max(1, rows)));
}

template <int kTerms>
TermsField<kTerms>::TermsField(const FieldSettings& settings) noexcept
    : field_(by_position_only(settings), *this) {}

template <int kTerms>
Innovation TermsField<kTerms>::take_with(const Observation& o, const Terms& terms_N) noexcept {
  Observation part = o;
  part.contact = 0;
  part.history.setZero();
  part.terms_N.template leftCols<kTerms>() = terms_N;
  Innovation innovation;
  innovation.predicted = sample_count() > 0;
  innovation.error_N = field_.learn_from(part);
  return innovation;
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
