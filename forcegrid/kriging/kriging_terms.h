// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// Kriging where forces depend on position except for a few terms R_j with unknown factors:
///
///   F_k + sum_j gamma_j R_jk = G(p_k),   G a field of the position
///
/// Kriging is linear in the data, so fields f of the forces and r_j of the terms, over the same
/// samples with the same kernel, make G = f + sum_j gamma_j r_j for all gamma at once, and the
/// gamma that predicts new samples best is that of least squares over the innovations
///
///   e_k = F_k - f(p_k),   d_jk = R_jk - r_j(p_k):   min sum_k |e_k + sum_j gamma_j d_jk|^2
///                                                       + kPrior_N2 |gamma|^2
///
/// with the sums forgotten by kKept per sample and gamma kept within limits of the kind of terms.
///
/// Nothing is ever doubted and contacts are not distinguished: alone it forgets nothing. Use it as
/// a candidate of an ensemble, which renders others where they predict better. Cost: that of one
/// DictionaryField, since all of them share one factor, which carries the data of all.
/// Source: docs/kriging.md. Real-time: nothing allocates, locks or throws. Threads: one.
template <int kTerms>
class TermsField : public Field {
 public:
  using Terms = Eigen::Matrix<double, 3, kTerms>;  ///< [N] column j is R_j
  using Factors = Eigen::Matrix<double, kTerms, 1>;
  static constexpr int kMostSamples = 32;
  static constexpr double kPrior_N2 = 1e-2;
  static constexpr double kKept = 0.98;
  static constexpr double kMostFactor = 3.0;

  /// @param settings as for DictionaryField, without stiffness and history features.
  explicit TermsField(const FieldSettings& settings) noexcept;
  TermsField(const TermsField&) = delete;  // its parts refer to each other
  TermsField& operator=(const TermsField&) = delete;

  const FieldSettings& settings() const noexcept override { return field_.settings(); }
  int sample_count() const noexcept override { return field_.sample_count(); }
  int row_count() const noexcept override { return field_.row_count(); }
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override {
    return field_.stiffness_N_per_m(position_m, history);
  }
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override {
    return field_.deviation_N(position_m, history);
  }

  bool prepare() noexcept override { return field_.prepare(); }
  bool ready() const noexcept override { return field_.ready(); }
  void expect_reads(bool expected) noexcept override { field_.expect_reads(expected); }

  const Factors& factors() const noexcept { return field_.factors(); }

 protected:
  Innovation take_with(const Observation& observation, const Terms& terms_N) noexcept;
  Reading read_field(const Eigen::Vector3d& position_m) const noexcept {  ///< G
    return field_.read(position_m, History::Zero());
  }
  /// The nearest factors that make sense, each within kMostFactor of zero.
  virtual Factors limited(Factors factors) const noexcept = 0;

 private:
  using Base = DictionaryField<double, kMostSamples, 0, kTerms>;

  /// G, and the fields that it is the sum of: their data differ, their samples and factor do not.
  class SumField final : public Base {
   public:
    /// @param owner limits the factors.
    SumField(const FieldSettings& settings, const TermsField& owner) noexcept
        : Base(settings), owner_(owner) {}
    /// As Field::take(), and learns the factors. @returns [N] the error of the sum.
    double learn_from(const Observation& observation) noexcept;
    const Factors& factors() const noexcept { return factors_; }
    double deviation_N(const Eigen::Vector3d& position_m,
                       const History& history) const noexcept override;

   private:
    using Columns = typename Base::Factor::Columns;

    void predicted(const Observation& observation, const Columns& x) noexcept override;
    void solve_weights() noexcept override;
    void learn(const Eigen::Vector3d& force_error_N, const Terms& term_errors_N) noexcept;

    const TermsField& owner_;
    double error_N_ = 0.0;
    Factors factors_ = Factors::Zero();
    Eigen::Matrix<double, kTerms, kTerms> squares_N2_ =
        Eigen::Matrix<double, kTerms, kTerms>::Zero();
    Factors products_N2_ = Factors::Zero();
  };

  SumField field_;
};

/// What a simulator would return if it had the time to solve to the end. If it corrects only a
/// share of its state's error before it answers, it lags behind, F_k = F_{k-1} + share (F(p_k) -
/// F_{k-1}). So the right answer is F_k + gamma R_k, with the rise R_k = F_k - F_{k-1} of its
/// answer and gamma = (1 - share) / share.
///
/// Observations without a rise (the first of a contact, or after a lost one) are not taken; answers
/// to queries are solved to the end, so their rise counts as zero.
/// Failure: noise grows by 1 + 2 gamma; lags of a higher order.
class LagField final : public TermsField<1> {
 public:
  using TermsField::TermsField;
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  Innovation take(const Observation& observation) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;

 private:
  Factors limited(Factors factors) const noexcept override { return factors.cwiseMax(0.0); }
};

/// An object that resists and relaxes: a viscosity b, and an elastic force passed through a linear
/// filter with poles at some tau, as in quasi-linear viscoelasticity. The inverse of such a filter
/// has poles as well,
///
///   G(p) = F + b v + sum_j gamma_j L_j,   tau_j dL_j/dt = F - L_j,
///
/// so the terms are the velocity and the force itself, low-passed (PathTerms). The neighbours
/// approximate what lies between two time constants.
///
/// The rendered force goes into the terms, which closes a loop: F (1 + sum_j gamma_j / (1 + tau_j
/// s)) = G - b v. With b >= 0, and the negative gamma_j adding up to no less than -kMostFeedback,
/// it is stable and damps: for Re s >= 0 the real part of 1 / (1 + tau s) lies between 0 and 1, so
/// that of the bracket is at least 1 - kMostFeedback. Failure: relaxation far slower than the
/// slowest; viscosity that depends on the position. Source: Fung, Biomechanics, 2nd ed. (1993),
/// section 7.6, for the model.
class RelaxationField final : public TermsField<kPathTerms> {
 public:
  using TermsField::TermsField;
  static constexpr double kMostFeedback = 0.7;
  static constexpr std::array<double, kPathTerms - 1> kTimeConstants_s = {0.05, 0.25, 1.2};

  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void observe(const PathTerms& terms_N) noexcept override { now_N_ = terms_N; }
  Innovation take(const Observation& observation) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;

 private:
  Factors limited(Factors factors) const noexcept override;

  PathTerms now_N_ = PathTerms::Zero();
};

}  // namespace forcegrid::kriging
