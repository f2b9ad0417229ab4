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
// Of what check_stiffness() has summed up, from sample to sample.
constexpr double kCheckKept = 0.95;
// Nuggets of variance that a change of a force may have before stiffness is blamed: two, and half
// as much again.
constexpr double kForceNoise = 3.0;
// Of the kernel's length: over longer ways a mean of two stiffnesses says little.
constexpr double kCheckReach = 0.25;

}  // namespace

PairField::PairField(const PairFieldSettings& settings) noexcept : settings_(settings) { clear(); }

void PairField::clear() noexcept {
  for (Stored& s : stored_) {
    s.used = false;
  }
  block_total_ = 0;
  block_count_ = 0;
  sample_count_ = 0;
  transient_ = kNone;
  takes_since_factorisation_ = 0;
  stage_ = Stage::kReady;
  fit_due_ = false;
  factor_stale_ = false;
  factor_.clear();
  lanes_used_ = few_used_ = 0;
  has_before_ = false;
  unexplained_N2_ = moved_m2_ = 0.0;
}

void PairField::begin(const PairVector& positions_m, const PairVector& forces_N,
                      const Matrix6* stiffness_N_per_m) noexcept {
  new_position_m_ = positions_m;
  new_force_N_ = forces_N;
  new_has_stiffness_ = stiffness_N_per_m != nullptr && settings_.stiffness_samples > 0;
  for (int i = 0; new_has_stiffness_ && i < kStiffnessNumbers; ++i) {
    const int b = kStiffnessRow[i];
    const int c = kStiffnessColumn[i];
    new_stiffness_N_per_m_[static_cast<std::size_t>(i)] =
        0.5 * ((*stiffness_N_per_m)(b, c) + (*stiffness_N_per_m)(c, b));
  }
  innovation_ = {};
  stage_ = Stage::kPredict;
}

bool PairField::prepare() noexcept {
  switch (stage_) {
    case Stage::kReady:
      return false;
    case Stage::kPredict:
      check_stiffness();
      predict();
      stage_ = Stage::kChange;
      return true;
    case Stage::kChange:
      settle_transient();
      make_room();
      append_new();
      return true;
    case Stage::kAppend:
      append_some();
      return true;
    case Stage::kFit:
      fit();
      stage_ = Stage::kReady;
      return true;
  }
  return false;
}

// x_ <- L^-1 Cov(rows, F(position)), or of a part of J(position).
void PairField::solve_covariances(const PairVector& position_m, int part) noexcept {
  const PairKernel& kernel = settings_.kernel;
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const PairVector& at_m = of_block(b).position_m;
    const int other = block(b).part;
    Matrix6 k;  // rows: of the block
    if (part == Block::kForce) {
      k = other == Block::kForce
              ? Matrix6(kernel.force_force(at_m, position_m))
              : Matrix6(kernel.force_stiffness(position_m, at_m, other).transpose());
    } else {
      k = other == Block::kForce ? kernel.force_stiffness(at_m, position_m, part)
                                 : kernel.stiffness_stiffness(at_m, other, position_m, part);
    }
    const int rows = block(b).rows();
    for (std::size_t c = 0; c < kRows; ++c) {
      for (int i = 0; i < rows; ++i) {
        x_.column[c][row + static_cast<std::size_t>(i)] = k(i, static_cast<int>(c));
      }
    }
    row += static_cast<std::size_t>(rows);
  }
  factor_.solve(x_, part == Block::kForce || part_size(part) > 3 ? 6 : 3);
}

void PairField::predict() noexcept {
  solve_covariances(new_position_m_, Block::kForce);
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
  std::int16_t slot = 0;
  while (stored_[static_cast<std::size_t>(slot)].used) {
    ++slot;
  }
  stored_[static_cast<std::size_t>(slot)] = {new_position_m_,       new_force_N_, new_position_m_,
                                             new_force_N_,          0.0,          true,
                                             new_stiffness_N_per_m_};
  transient_ = slot;
  ++sample_count_;
  if (new_has_stiffness_) {
    limit_stiffness();
  }
  const bool stale = factor_stale_;
  if (stale) {
    begin_factor();
  }
  blocks_[static_cast<std::size_t>(block_total_++)] = {slot, Block::kForce};
  for (std::int16_t part = 0; new_has_stiffness_ && part < kStiffnessParts; ++part) {
    blocks_[static_cast<std::size_t>(block_total_++)] = {slot, part};
  }
  stage_ = Stage::kAppend;
  if (!stale) {
    append_next();
    if (block_count_ == block_total_) {
      end_change();
    }
  }
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

// What the mean stiffness of two samples leaves unexplained of the change of force between them,
// F' - F - 1/2 (J + J') dp, is noise of the forces and of the stiffness.
void PairField::check_stiffness() noexcept {
  if (new_has_stiffness_ && has_before_) {
    const PairVector moved_m = new_position_m_ - before_m_;
    PairVector rest_N = new_force_N_ - before_N_;
    for (int i = 0; i < kStiffnessNumbers; ++i) {
      const int b = kStiffnessRow[i];
      const int c = kStiffnessColumn[i];
      const auto n = static_cast<std::size_t>(i);
      const double entry = 0.5 * (new_stiffness_N_per_m_[n] + before_N_per_m_[n]);
      rest_N[b] -= entry * moved_m[c];
      if (b != c) {
        rest_N[c] -= entry * moved_m[b];
      }
    }
    const double squared_m2 = moved_m.squaredNorm();
    const double reach_m = kCheckReach * settings_.kernel.length_m;
    if (squared_m2 < reach_m * reach_m) {
      unexplained_N2_ = kCheckKept * unexplained_N2_ + rest_N.squaredNorm() -
                        kForceNoise * kRows * settings_.nugget_N2;
      moved_m2_ = kCheckKept * moved_m2_ + squared_m2;
    }
  }
  has_before_ = new_has_stiffness_;
  before_m_ = new_position_m_;
  before_N_ = new_force_N_;
  before_N_per_m_ = new_stiffness_N_per_m_;
}

double PairField::stiffness_variance(const Stored& sample) const noexcept {
  double squares = 0.0;  // of all 36 entries
  for (int i = 0; i < kStiffnessNumbers; ++i) {
    const double entry = sample.stiffness_N_per_m[static_cast<std::size_t>(i)];
    squares += (kStiffnessRow[i] == kStiffnessColumn[i] ? 1.0 : 2.0) * entry * entry;
  }
  const double noise = settings_.stiffness_noise_N_per_m;
  const double relative = settings_.relative_stiffness_noise;
  const double doubt_length_m = settings_.kernel.length_m / 3.0;
  const double learnt =
      moved_m2_ > 0.0 ? std::max(0.0, unexplained_N2_) / (kRows * moved_m2_) : 0.0;
  return noise * noise + relative * relative * squares + learnt +
         sample.doubt_N2 / (doubt_length_m * doubt_length_m);
}

// The next rows of the factor.
void PairField::append_next() noexcept {
  const Block& next = block(block_count_);
  const Stored& s = of_block(block_count_);
  const int part = next.part;
  if (!solved_ || part != Block::kForce) {
    solve_covariances(s.position_m, part);
  }
  if (part == Block::kForce) {
    Matrix6 own = settings_.kernel.force_force(s.position_m, s.position_m);
    own.diagonal().array() += settings_.nugget_N2 + s.doubt_N2;
    factor_.append<kRows>(x_, own, s.force_N, 0.5 * settings_.nugget_N2);
  } else {
    const double variance = stiffness_variance(s);
    Matrix6 own = settings_.kernel.stiffness_stiffness(s.position_m, part, s.position_m, part);
    own.diagonal().array() += variance;
    const double* const values = s.stiffness_N_per_m.data() + part_begin(part);
    if (part_size(part) == kRows) {
      factor_.append<kRows>(x_, own, Eigen::Map<const PairVector>(values), 0.5 * variance);
    } else {
      const Eigen::Matrix3d few = own.topLeftCorner<3, 3>();
      factor_.append<3>(x_, few, Eigen::Map<const Eigen::Vector3d>(values), 0.5 * variance);
    }
  }
  ++block_count_;
  solved_ = false;
}

void PairField::append_some() noexcept {
  for (int work = 0; work < kAppendsAPiece && block_count_ < block_total_;) {
    work += block(block_count_).part == Block::kForce ? 1 : 2;
    append_next();
  }
  if (block_count_ == block_total_) {
    end_change();
  }
}

// Keeps the stiffness of the newest samples only, leaving room for one more. Blocks are in the
// order of their samples' times.
void PairField::limit_stiffness() noexcept {
  int kept = 0;
  int oldest = kNone;
  for (int b = block_total_ - 1; b >= 0; --b) {
    if (block(b).part == 0) {
      ++kept;
      oldest = b;
    }
  }
  if (kept >= settings_.stiffness_samples) {
    remove_blocks(oldest, kStiffnessParts);
  }
}

// Needs block_count_ == block_total_.
void PairField::remove_blocks(int first, int count) noexcept {
  int before = 0;
  for (int b = 0; b < first; ++b) {
    before += block(b).rows();
  }
  int rows = 0;
  for (int b = first; b < first + count; ++b) {
    rows += block(b).rows();
  }
  if (!factor_stale_) {
    factor_.remove(before, rows);
  }
  solved_ = solved_ && first + count == block_total_;  // rows in front of it stay as they are
  std::copy(blocks_.begin() + first + count, blocks_.begin() + block_total_,
            blocks_.begin() + first);
  block_count_ -= count;
  block_total_ -= count;
}

void PairField::remove(int slot) noexcept {
  int first = 0;
  while (block(first).slot != slot) {
    ++first;
  }
  int end = first + 1;
  while (end < block_total_ && block(end).slot == slot) {
    ++end;
  }
  remove_blocks(first, end - first);
  --sample_count_;
  stored_[static_cast<std::size_t>(slot)].used = false;
}

// The factor begins anew; prepare() appends the blocks some by some.
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
  const double inverse_l = 1.0 / settings_.kernel.length_m;
  Matrix6 moment = Matrix6::Zero();
  PairVector sum = PairVector::Zero();
  std::size_t lane = 0;
  std::size_t few = 0;
  const double* weights = alpha_.data();
  for (int b = 0; b < block_count_; weights += block(b).rows(), ++b) {
    const PairVector& position_m = of_block(b).position_m;
    const int part = block(b).part;
    if (part == Block::kForce) {
      const PairVector weight = Eigen::Map<const PairVector>(weights);
      for (std::size_t a = 0; a < kRows; ++a) {
        const auto axis = static_cast<Eigen::Index>(a);
        lanes_[a][lane] = static_cast<float>(position_m[axis] * inverse_l);
        lanes_[kRows + a][lane] = static_cast<float>(weight[axis]);
      }
      moment += 0.5 * (weight * position_m.transpose() + position_m * weight.transpose());
      sum += weight;
      ++lane;
      continue;
    }
    for (int i = 0; i < part_size(part); ++i) {
      const int number = part_begin(part) + i;
      const int r = kStiffnessRow[number];
      const int c = kStiffnessColumn[number];
      const double entry_N2 = (r == c ? 1.0 : 0.5) * weights[i];
      few_lanes_[static_cast<std::size_t>(kRows + number)][few] =
          static_cast<float>(entry_N2 * inverse_l);
      moment(r, c) += entry_N2;
      if (r != c) {
        moment(c, r) += entry_N2;
      }
    }
    if (part == kStiffnessParts - 1) {
      for (std::size_t a = 0; a < kRows; ++a) {
        few_lanes_[a][few] =
            static_cast<float>(position_m[static_cast<Eigen::Index>(a)] * inverse_l);
      }
      ++few;
    }
  }
  lanes_used_ = kriging::padded(static_cast<int>(lane), kPairLanes);
  few_used_ = static_cast<int>(few);
  for (; lane < static_cast<std::size_t>(lanes_used_); ++lane) {
    for (std::size_t a = 0; a < kRows; ++a) {
      lanes_[a][lane] = kFarAway;
      lanes_[kRows + a][lane] = 0.0F;
    }
  }
  for (; few < kPairFewLanes; ++few) {
    for (std::size_t row = 0; row < few_lanes_.size(); ++row) {
      few_lanes_[row][few] = row < kRows ? kFarAway : 0.0F;
    }
  }
  moment.diagonal().array() += moment.trace();
  linear_N_per_m_ = (settings_.kernel.stiffness_variance() * moment).cast<float>();
  constant_N_ = (settings_.kernel.constant_N2 * sum).cast<float>();
}

PairTerms PairField::terms() const noexcept {
  return {lanes_[0].data(), kStride, lanes_used_, few_lanes_[0].data(), few_used_};
}

PairField::Reading PairField::read(const PairVector& positions_m) const noexcept {
  const Eigen::Matrix<float, 6, 1> p = positions_m.cast<float>();
  const Eigen::Matrix<float, 6, 1> in_lengths =
      p * static_cast<float>(1.0 / settings_.kernel.length_m);
  const PairSum radial = pair_sum(terms(), in_lengths.data());
  const Eigen::Matrix<float, 6, 1> force =
      constant_N_ + linear_N_per_m_ * p +
      Eigen::Map<const Eigen::Matrix<float, 6, 1>>(radial.force_N);
  return {force.cast<double>(),
          settings_.kernel.length_m * std::sqrt(static_cast<double>(radial.nearest2))};
}

Matrix6 PairField::stiffness_N_per_m(const PairVector& positions_m) const noexcept {
  const double inverse_l = 1.0 / settings_.kernel.length_m;
  const PairTerms of = terms();
  const PairVector in_lengths = positions_m * inverse_l;
  PairVector d;
  Matrix6 radial = Matrix6::Zero();
  for (int lane = 0; lane < lanes_used_; ++lane) {
    PairVector alpha;
    for (int a = 0; a < kRows; ++a) {
      d[a] = in_lengths[a] - static_cast<double>(of.position(a)[lane]);
      alpha[a] = static_cast<double>(of.weight(a)[lane]);
    }
    const double phi = std::exp(-0.5 * d.squaredNorm());
    const double along = d.dot(alpha);
    radial -= phi * (alpha * d.transpose() + d * alpha.transpose() - along * d * d.transpose());
    radial.diagonal().array() -= phi * along;
  }
  for (int lane = 0; lane < few_used_; ++lane) {
    Matrix6 weight;
    for (int a = 0; a < kRows; ++a) {
      d[a] = in_lengths[a] - static_cast<double>(of.few_position(a)[lane]);
    }
    for (int i = 0; i < kStiffnessNumbers; ++i) {
      weight(kStiffnessRow[i], kStiffnessColumn[i]) = weight(
          kStiffnessColumn[i], kStiffnessRow[i]) = static_cast<double>(of.few_weight(i)[lane]);
    }
    const double phi = std::exp(-0.5 * d.squaredNorm());
    const PairVector along = weight * d;
    const double rest = weight.trace() - d.dot(along);
    radial += phi * (2.0 * weight - 2.0 * (along * d.transpose() + d * along.transpose()) -
                     rest * d * d.transpose());
    radial.diagonal().array() += phi * rest;
  }
  return linear_N_per_m_.cast<double>() + inverse_l * radial;
}

}  // namespace forcegrid::pair
