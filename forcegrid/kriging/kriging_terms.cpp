// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_terms.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <utility>

namespace forcegrid::kriging {
namespace {

// Independent of the data, because all parts must choose the same samples.
FieldSettings by_position_only(FieldSettings settings) noexcept {
  settings.spacing.newtons = std::numeric_limits<double>::max();
  settings.surprise = std::numeric_limits<double>::max();
  return settings;
}

template <typename Part, std::size_t... kIndex>
std::array<Part, sizeof...(kIndex)> parts(const FieldSettings& settings,
                                          std::index_sequence<kIndex...> /*one each*/) noexcept {
  return {((void)kIndex, Part(settings))...};
}

}  // namespace

template <int kTerms>
TermsField<kTerms>::TermsField(const FieldSettings& settings) noexcept
    : forces_(by_position_only(settings)),
      terms_(parts<Part>(forces_.settings(), std::make_index_sequence<kTerms>())) {}

template <int kTerms>
Innovation TermsField<kTerms>::take_with(const Observation& o, const Terms& terms_N) noexcept {
  Observation part = o;
  part.contact = 0;
  part.history.setZero();
  Innovation innovation;
  innovation.predicted = sample_count() > 0;
  const Eigen::Vector3d force_error_N =
      o.force_N - forces_.read(o.position_m, part.history).force_N;
  Terms term_errors_N = terms_N;
  for (int j = 0; j < kTerms; ++j) {
    term_errors_N.col(j) -=
        terms_[static_cast<std::size_t>(j)].read(o.position_m, part.history).force_N;
  }
  innovation.error_N = (force_error_N + term_errors_N * factors_).norm();
  if (innovation.predicted && !o.from_query) {
    learn(force_error_N, term_errors_N);
  }
  forces_.take(part);
  for (int j = 0; j < kTerms; ++j) {
    part.force_N = terms_N.col(j);
    terms_[static_cast<std::size_t>(j)].take(part);
  }
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

template <int kTerms>
Reading TermsField<kTerms>::read_field(const Eigen::Vector3d& position_m) const noexcept {
  Reading reading = forces_.read(position_m, History::Zero());
  for (int j = 0; j < kTerms; ++j) {
    reading.force_N +=
        factors_[j] * terms_[static_cast<std::size_t>(j)].read(position_m, History::Zero()).force_N;
  }
  return reading;
}

template <int kTerms>
Eigen::Matrix3d TermsField<kTerms>::stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                                      const History& history) const noexcept {
  Eigen::Matrix3d sum = forces_.stiffness_N_per_m(position_m, history);
  for (int j = 0; j < kTerms; ++j) {
    sum += factors_[j] * terms_[static_cast<std::size_t>(j)].stiffness_N_per_m(position_m, history);
  }
  return sum;
}

template <int kTerms>
double TermsField<kTerms>::deviation_N(const Eigen::Vector3d& position_m,
                                       const History& history) const noexcept {
  std::array<const Part*, kTerms> parts{};
  for (std::size_t j = 0; j < parts.size(); ++j) {
    parts[j] = &terms_[j];
  }
  return forces_.deviation_with(parts, factors_, position_m, history);
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
