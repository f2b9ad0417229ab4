// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_field.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/dictionary_rules.h"

namespace forcegrid::pair {
namespace {

constexpr float kFarAway = 1e3F;  // in lengths: a lane without a sample
// Removing rows rounds a little each time; a factor made anew has no memory of it.
constexpr int kTakesBetweenFactorisations = 1024;

}  // namespace

PairField::PairField(const PairFieldSettings& settings) noexcept : settings_(settings) { clear(); }

void PairField::clear() noexcept {
  for (Stored& s : stored_) {
    s.used = false;
  }
  block_count_ = 0;
  sample_count_ = 0;
  transient_ = kNone;
  takes_since_factorisation_ = 0;
  stage_ = Stage::kReady;
  fit_due_ = false;
  factor_stale_ = false;
  factor_.clear();
  lanes_used_ = 0;
}

void PairField::begin(const PairVector& positions_m, const PairVector& forces_N) noexcept {
  new_position_m_ = positions_m;
  new_force_N_ = forces_N;
  innovation_ = {};
  stage_ = Stage::kPredict;
}

bool PairField::prepare() noexcept {
  switch (stage_) {
    case Stage::kReady:
      return false;
    case Stage::kPredict:
      predict();
      stage_ = Stage::kChange;
      return true;
    case Stage::kChange:
      settle_transient();
      make_room();
      append_new();
      return true;
    case Stage::kRefactor:
      for (int n = 0; n < kAppendsAPiece && block_count_ < sample_count_; ++n) {
        append(blocks_[static_cast<std::size_t>(block_count_)]);
      }
      if (block_count_ == sample_count_) {
        end_change();
      }
      return true;
    case Stage::kFit:
      fit();
      stage_ = Stage::kReady;
      return true;
  }
  return false;
}

// x_ <- L^-1 Cov(rows, F(position)).
void PairField::solve_covariances(const PairVector& position_m) noexcept {
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const Matrix6 k = settings_.kernel.force_force(position_m, of_block(b).position_m);
    for (std::size_t c = 0; c < kRows; ++c) {
      for (int i = 0; i < kRows; ++i) {
        x_.column[c][row + static_cast<std::size_t>(i)] = k(static_cast<int>(c), i);
      }
    }
    row += kRows;
  }
  factor_.solve(x_, kRows);
}

void PairField::predict() noexcept {
  solve_covariances(new_position_m_);
  solved_ = true;
  factor_stale_ = ++takes_since_factorisation_ >= kTakesBetweenFactorisations;
  if (sample_count_ == 0) {
    return;
  }
  const PairVector error_N = new_force_N_ - factor_.mean<kRows>(x_);
  const double data_scale = std::max(1.0, factor_.squares() / factor_.rows());
  Matrix6 v = data_scale * (settings_.kernel.force_force(new_position_m_, new_position_m_) -
                            factor_.explained<kRows>(x_));
  v.diagonal().array() += settings_.nugget_N2;
  innovation_.predicted = true;
  innovation_.error_N = error_N.norm();
  innovation_.normalised = error_N.dot(v.ldlt().solve(error_N)) / kRows;
  innovation_.surprised = innovation_.normalised > settings_.surprise;
  if (innovation_.surprised) {
    doubt_samples(error_N);
    factor_stale_ = true;
  }
}

// Inflates the noise of the samples that the surprise contradicts.
void PairField::doubt_samples(const PairVector& error_N) noexcept {
  const double doubt_N2 =
      error_N.squaredNorm() / kRows * (1.0 - settings_.surprise / innovation_.normalised);
  const double reach_m = 2.0 * settings_.kernel.length_m;
  for (Stored& s : stored_) {
    if (s.used) {
      const double d2 = (s.position_m - new_position_m_).squaredNorm();
      s.doubt_N2 += doubt_N2 * std::exp(-0.5 * d2 / (reach_m * reach_m));
    }
  }
}

// Decides on the newest sample of before.
void PairField::settle_transient() noexcept {
  if (transient_ == kNone) {
    return;
  }
  const int slot = transient_;
  const Stored& t = stored_[static_cast<std::size_t>(slot)];
  const kriging::Settled settled = kriging::settle_newest(
      stored_, slot, settings_.spacing, settings_.nugget_N2, [&](const Stored& s) {
        return settings_.spacing.distance_m2((s.position_m - t.position_m).squaredNorm(),
                                             (s.force_N - t.force_N).squaredNorm());
      });
  transient_ = kNone;
  if (settled.fate == kriging::Settled::Fate::kReplaces) {
    remove(settled.replaced);
  } else if (settled.fate == kriging::Settled::Fate::kGoes) {
    remove(slot);
  }
}

void PairField::make_room() noexcept {
  if (sample_count_ < settings_.samples) {
    return;
  }
  remove(kriging::least_valuable(
      stored_, kNone,
      [](const Stored& a, const Stored& b) { return (a.position_m - b.position_m).squaredNorm(); },
      [this](int slot, double nearest_m2) {
        const Stored& s = stored_[static_cast<std::size_t>(slot)];
        return nearest_m2 /
               ((s.position_m - new_position_m_).squaredNorm() + kriging::kEvictionReach_m2) /
               (1.0 + s.doubt_N2 / (kriging::kDoubtedNuggets * settings_.nugget_N2));
      }));
}

void PairField::append_new() noexcept {
  int slot = 0;
  while (stored_[static_cast<std::size_t>(slot)].used) {
    ++slot;
  }
  stored_[static_cast<std::size_t>(slot)] = {new_position_m_, new_force_N_, new_position_m_,
                                             new_force_N_,    0.0,          true};
  transient_ = slot;
  blocks_[static_cast<std::size_t>(sample_count_++)] = slot;
  if (factor_stale_) {
    begin_factor();
    stage_ = Stage::kRefactor;
    return;
  }
  append(slot);
  end_change();
}

void PairField::end_change() noexcept {
  fit_due_ = true;
  stage_ = reads_expected_ ? Stage::kFit : Stage::kReady;
}

void PairField::expect_reads(bool expected) noexcept {
  reads_expected_ = expected;
  if (expected && fit_due_ && stage_ == Stage::kReady) {
    stage_ = Stage::kFit;
  }
}

// The next rows of the factor; `slot` stands in blocks_ already.
void PairField::append(int slot) noexcept {
  const Stored& s = stored_[static_cast<std::size_t>(slot)];
  if (!solved_) {
    solve_covariances(s.position_m);
  }
  Matrix6 own = settings_.kernel.force_force(s.position_m, s.position_m);
  own.diagonal().array() += settings_.nugget_N2 + s.doubt_N2;
  factor_.append<kRows>(x_, own, s.force_N, 0.5 * settings_.nugget_N2);
  ++block_count_;
  solved_ = false;
}

void PairField::remove(int slot) noexcept {
  const auto end = blocks_.begin() + sample_count_;
  const auto found = std::find(blocks_.begin(), end, slot);
  const auto block = static_cast<int>(found - blocks_.begin());
  solved_ = solved_ && block == block_count_ - 1;  // rows in front of it stay as they are
  if (!factor_stale_) {
    factor_.remove(kRows * block, kRows);
  }
  std::copy(found + 1, end, found);
  --block_count_;
  --sample_count_;
  stored_[static_cast<std::size_t>(slot)].used = false;
}

// The factor begins anew; prepare() appends the samples one by one.
void PairField::begin_factor() noexcept {
  factor_.clear();
  block_count_ = 0;
  takes_since_factorisation_ = 0;
  factor_stale_ = false;
  solved_ = false;
}

// Solves for the weights, and for the sums that do not depend on where the field is read.
void PairField::fit() noexcept {
  fit_due_ = false;
  factor_.weights(alpha_.data());
  Matrix6 moment = Matrix6::Zero();
  PairVector sum = PairVector::Zero();
  for (int b = 0; b < block_count_; ++b) {
    const PairVector weight =
        Eigen::Map<const PairVector>(alpha_.data() + static_cast<std::ptrdiff_t>(kRows) * b);
    const PairVector& position_m = of_block(b).position_m;
    const auto lane = static_cast<std::size_t>(b);
    for (std::size_t a = 0; a < kRows; ++a) {
      const auto axis = static_cast<Eigen::Index>(a);
      lanes_[a][lane] = static_cast<float>(position_m[axis] / settings_.kernel.length_m);
      lanes_[kRows + a][lane] = static_cast<float>(weight[axis]);
    }
    moment += 0.5 * (weight * position_m.transpose() + position_m * weight.transpose());
    sum += weight;
  }
  lanes_used_ = kriging::padded(block_count_, kPairLanes);
  for (auto lane = static_cast<std::size_t>(block_count_);
       lane < static_cast<std::size_t>(lanes_used_); ++lane) {
    for (std::size_t a = 0; a < kRows; ++a) {
      lanes_[a][lane] = kFarAway;
      lanes_[kRows + a][lane] = 0.0F;
    }
  }
  moment.diagonal().array() += moment.trace();
  linear_N_per_m_ = (settings_.kernel.stiffness_variance() * moment).cast<float>();
  constant_N_ = (settings_.kernel.constant_N2 * sum).cast<float>();
}

PairField::Reading PairField::read(const PairVector& positions_m) const noexcept {
  const Eigen::Matrix<float, 6, 1> p = positions_m.cast<float>();
  const Eigen::Matrix<float, 6, 1> in_lengths =
      p * static_cast<float>(1.0 / settings_.kernel.length_m);
  const PairSum radial = pair_sum({lanes_[0].data(), kStride, lanes_used_}, in_lengths.data());
  const Eigen::Matrix<float, 6, 1> force =
      constant_N_ + linear_N_per_m_ * p +
      Eigen::Map<const Eigen::Matrix<float, 6, 1>>(radial.force_N);
  return {force.cast<double>(),
          settings_.kernel.length_m * std::sqrt(static_cast<double>(radial.nearest2))};
}

Matrix6 PairField::stiffness_N_per_m(const PairVector& positions_m) const noexcept {
  const double inverse_l = 1.0 / settings_.kernel.length_m;
  Matrix6 radial = Matrix6::Zero();
  for (std::size_t lane = 0; lane < static_cast<std::size_t>(lanes_used_); ++lane) {
    PairVector d;
    PairVector alpha;
    for (std::size_t a = 0; a < kRows; ++a) {
      const auto axis = static_cast<Eigen::Index>(a);
      d[axis] = positions_m[axis] * inverse_l - static_cast<double>(lanes_[a][lane]);
      alpha[axis] = static_cast<double>(lanes_[kRows + a][lane]);
    }
    const double phi = std::exp(-0.5 * d.squaredNorm());
    const double along = d.dot(alpha);
    radial -= phi * (alpha * d.transpose() + d * alpha.transpose() - along * d * d.transpose());
    radial.diagonal().array() -= phi * along;
  }
  return linear_N_per_m_.cast<double>() + inverse_l * radial;
}

}  // namespace forcegrid::pair
