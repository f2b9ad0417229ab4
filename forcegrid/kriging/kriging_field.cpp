// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_field.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/dictionary_rules.h"

namespace forcegrid::kriging {
namespace {

constexpr double kNeededValue = 1e6;
constexpr double kLeastScaleVariance = 1e-4;
constexpr double kMostScaleVariance = 0.09;
constexpr double kScaleKnown = 1e-7;  // below this variance another sample adds nothing
constexpr double kScaleForgotten = 0.3;
constexpr double kLeastScale = 0.5;
constexpr double kMostScale = 2.0;
constexpr double kFarAway_m = 1e3;

}  // namespace

template <typename Real, int N, int M, int K>
DictionaryField<Real, N, M, K>::DictionaryField(const FieldSettings& settings) noexcept
    : settings_(settings),
      inverse_length_per_m_(static_cast<Real>(1.0 / settings.kernel.length_m)) {
  collapse();
}

template <typename Real, int N, int M, int K>
double DictionaryField<Real, N, M, K>::data_scale() const noexcept {
  return std::max(1.0, (factor_.squares() - explained_squares()) / std::max(1, factor_.rows()));
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::covariances_of_force(
    const Eigen::Vector3d& p, const History& h, typename Factor::Columns& x) const noexcept {
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    const Stored& s = stored_[static_cast<std::size_t>(block.slot)];
    if (block.stiffness) {
      const Matrix36d k = settings_.kernel.force_stiffness(p, s.position_m);
      for (std::size_t c = 0; c < 3; ++c) {
        for (int i = 0; i < 6; ++i) {
          x.column[c][row + static_cast<std::size_t>(i)] = k(static_cast<int>(c), i);
        }
      }
      row += 6;
    } else {
      const Eigen::Matrix3d k = settings_.kernel.force_force(p, h, s.position_m, s.history);
      for (std::size_t c = 0; c < 3; ++c) {
        for (int i = 0; i < 3; ++i) {
          x.column[c][row + static_cast<std::size_t>(i)] = k(static_cast<int>(c), i);
        }
      }
      row += 3;
    }
  }
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::covariances_of_stiffness(
    const Eigen::Vector3d& p, typename Factor::Columns& x) const noexcept {
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    const Stored& s = stored_[static_cast<std::size_t>(block.slot)];
    if (block.stiffness) {
      const Matrix6d k = settings_.kernel.stiffness_stiffness(p, s.position_m);
      for (std::size_t c = 0; c < 6; ++c) {
        for (int i = 0; i < 6; ++i) {
          x.column[c][row + static_cast<std::size_t>(i)] = k(static_cast<int>(c), i);
        }
      }
      row += 6;
    } else {
      const Matrix36d k = settings_.kernel.force_stiffness(s.position_m, p);
      for (std::size_t c = 0; c < 6; ++c) {
        for (int i = 0; i < 3; ++i) {
          x.column[c][row + static_cast<std::size_t>(i)] = k(i, static_cast<int>(c));
        }
      }
      row += 3;
    }
  }
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::append_force(int slot, bool solved) noexcept {
  const Stored& s = stored_[static_cast<std::size_t>(slot)];
  if (!solved) {
    covariances_of_force(s.position_m, s.history, x_);
    factor_.solve(x_, 3);
  }
  Eigen::Matrix3d own =
      settings_.kernel.force_force(s.position_m, s.history, s.position_m, s.history);
  const double share = s.close ? settings_.fitted_share : 1.0;
  const double noise_N2 = share * settings_.nugget_N2 / s.count;
  own.diagonal().array() += noise_N2 + s.doubt_N2;
  factor_.template append<3>(x_, own, s.force_N, 0.5 * noise_N2);
  append_terms<3>(slot);
  blocks_[static_cast<std::size_t>(block_count_++)] = {static_cast<std::int16_t>(slot), false};
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::append_stiffness(int slot) noexcept {
  const Stored& s = stored_[static_cast<std::size_t>(slot)];
  covariances_of_stiffness(s.position_m, x_);
  factor_.solve(x_, 6);
  const double variance = stiffness_variance(s.stiffness_N_per_m, s.doubt_N2);
  Matrix6d own = settings_.kernel.stiffness_stiffness(s.position_m, s.position_m);
  own.diagonal().array() += variance;
  factor_.template append<6>(x_, own, s.stiffness_N_per_m, 0.5 * variance);
  append_terms<6>(slot);
  blocks_[static_cast<std::size_t>(block_count_++)] = {static_cast<std::int16_t>(slot), true};
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::remove_block(int block) noexcept {
  int first = 0;
  for (int b = 0; b < block; ++b) {
    first += blocks_[static_cast<std::size_t>(b)].rows();
  }
  factor_.remove(first, blocks_[static_cast<std::size_t>(block)].rows());
  std::copy(blocks_.begin() + block + 1, blocks_.begin() + block_count_, blocks_.begin() + block);
  --block_count_;
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::remove_sample(int slot) noexcept {
  for (int b = block_count_ - 1; b >= 0; --b) {
    if (blocks_[static_cast<std::size_t>(b)].slot == slot) {
      remove_block(b);
    }
  }
  stored_[static_cast<std::size_t>(slot)].used = false;
  --sample_count_;
  if (transient_ == slot) {
    transient_ = kNone;
  }
}

// Inflates the noise of the samples that a surprise contradicts.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::doubt_samples(const Eigen::Vector3d& around_m,
                                                   double doubt_N2) noexcept {
  const double reach_m = settings_.doubt_reach_m();
  for (Stored& s : stored_) {
    if (s.used) {
      const double d2 = (s.position_m - around_m).squaredNorm();
      s.doubt_N2 += doubt_N2 * std::exp(-0.5 * d2 / (reach_m * reach_m));
    }
  }
}

template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::begin_contact(std::uint64_t contact) noexcept {
  contact_ = contact;
  if (scale_variance_ > 0.0) {
    const double change = scale_ - 1.0;
    expected_scale_variance_ +=
        kScaleForgotten * (change * change + scale_variance_ - expected_scale_variance_);
    expected_scale_variance_ =
        std::clamp(expected_scale_variance_, kLeastScaleVariance, kMostScaleVariance);
  }
  scale_ = 1.0;
  scale_variance_ = sample_count_ > 0 ? expected_scale_variance_ : 0.0;
}

// The data of earlier contacts, with zeros for those of this one.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::earlier_contacts(
    std::array<double, Factor::kStride>& f) const noexcept {
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    const Stored& s = stored_[static_cast<std::size_t>(block.slot)];
    const Eigen::Vector3d own_N = s.force_N - feature_force_N(s);
    for (int i = 0; i < block.rows(); ++i) {
      const double value = block.stiffness ? s.stiffness_N_per_m[i] : own_N[i];
      f[row++] = s.contact == contact_ ? 0.0 : value;
    }
  }
}

// Needs `x`, the covariances of the observed quantity, solved, and `earlier`, earlier_contacts().
template <typename Real, int N, int M, int K>
template <int kCount>
void DictionaryField<Real, N, M, K>::scale_earlier_contacts(
    const typename Factor::Columns& x, const std::array<double, Factor::kStride>& earlier,
    const Eigen::Matrix<double, kCount, kCount>& variance,
    Eigen::Matrix<double, kCount, 1>& error) noexcept {
  using Vector = Eigen::Matrix<double, kCount, 1>;
  Vector predicted = Vector::Zero();
  for (std::size_t r = 0; r < static_cast<std::size_t>(factor_.rows()); ++r) {
    for (std::size_t c = 0; c < static_cast<std::size_t>(kCount); ++c) {
      predicted[static_cast<int>(c)] += x.column[c][r] * earlier[r];
    }
  }
  const Eigen::Matrix<double, kCount, kCount> inverse = variance.inverse();
  double information = predicted.dot(inverse * predicted);
  double correction = predicted.dot(inverse * error);
  if (!(information > 0.0) || !std::isfinite(information) || !std::isfinite(correction)) {
    return;
  }
  const Vector left = error - correction / (1.0 / scale_variance_ + information) * predicted;
  const double doubt = std::max(1.0, left.dot(inverse * left) / kCount);
  information /= doubt;
  correction /= doubt;
  scale_variance_ = 1.0 / (1.0 / scale_variance_ + information);
  const double scale =
      std::clamp(scale_ * (1.0 + scale_variance_ * correction), kLeastScale, kMostScale);
  const double factor = scale / scale_;
  scale_ = scale;
  for (Stored& s : stored_) {
    if (s.used && s.contact != contact_) {
      const Eigen::Vector3d feature_N = feature_force_N(s);
      s.force_N += (factor - 1.0) * (s.force_N - feature_N);
      s.first_force_N += (factor - 1.0) * (s.first_force_N - feature_N);
      s.stiffness_N_per_m *= factor;
    }
  }
  factor_.add_to_data(earlier, factor - 1.0);
  error -= (factor - 1.0) * predicted;
}

template <typename Real, int N, int M, int K>
double DictionaryField<Real, N, M, K>::stiffness_variance(const Vector6d& stiffness_N_per_m,
                                                          double doubt_N2) const noexcept {
  const double noise = settings_.stiffness_noise_N_per_m;
  const double relative = settings_.relative_stiffness_noise;
  // A force doubted by some newtons makes the slope over a third of l doubtful as well.
  const double doubt_length_m = settings_.kernel.length_m / 3.0;
  return noise * noise + relative * relative * stiffness_N_per_m.squaredNorm() +
         doubt_N2 / (doubt_length_m * doubt_length_m);
}

// The stiffness shows at once how stiff this contact is, while the first force is still zero.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::scale_by_stiffness(const Observation& o) noexcept {
  typename Factor::Columns earlier;
  earlier_contacts(earlier.column[0]);
  factor_.solve(earlier, 3);
  covariances_of_stiffness(o.position_m, x_);
  factor_.solve(x_, 6);
  Matrix6d v = (settings_.kernel.stiffness_stiffness(o.position_m, o.position_m) -
                factor_.template explained<6>(x_)) *
               data_scale();
  v.diagonal().array() += stiffness_variance(o.stiffness_N_per_m, o.noise_N2);
  Vector6d error_N_per_m = o.stiffness_N_per_m - factor_.template mean<6>(x_);
  scale_earlier_contacts<6>(x_, earlier.column[0], v, error_N_per_m);
}

// Averages the removed sample `n` of the same place into the newest. A doubted one counts less.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::average_into(int slot, const Stored& n) noexcept {
  Stored& t = stored_[static_cast<std::size_t>(slot)];
  const double trusted = n.count / (1.0 + n.count * n.doubt_N2 / settings_.nugget_N2);
  const double kept = std::min(trusted, settings_.averaged - 1.0);
  const double share = kept / (kept + 1.0);
  t.position_m += share * (n.position_m - t.position_m);
  t.force_N += share * (n.force_N - t.force_N);
  t.history += share * (n.history - t.history);
  t.count = kept + 1.0;
  // Its stiffness has moved with it: a factor with rows of two places is no covariance's.
  bool had_stiffness = false;
  for (int b = block_count_ - 1; b >= 0; --b) {
    if (blocks_[static_cast<std::size_t>(b)].slot == slot) {
      had_stiffness = had_stiffness || blocks_[static_cast<std::size_t>(b)].stiffness;
      remove_block(b);
    }
  }
  append_force(slot, false);
  if (had_stiffness) {
    append_stiffness(slot);
  }
}

// Decides on the transient sample. @returns true if rows other than its own have moved.
template <typename Real, int N, int M, int K>
bool DictionaryField<Real, N, M, K>::settle_transient() noexcept {
  if (transient_ == kNone) {
    return false;
  }
  const int slot = transient_;
  const Stored& t = stored_[static_cast<std::size_t>(slot)];
  const bool averages = settings_.averaged > 1 && sample_count_ >= settings_.samples;
  const SampleSpacing spacing =
      averages ? settings_.averaged_spacing : settings_.spacing_among(sample_count_);
  const Settled settled =
      settle_newest(stored_, slot, spacing, settings_.nugget_N2, [&](const Stored& s) {
        return spacing.distance_m2(moved_m2(s, t.position_m, t.history),
                                   (s.force_N - t.force_N).squaredNorm());
      });
  if (settled.fate != Settled::Fate::kGoes) {
    transient_ = kNone;
    if (settled.fate == Settled::Fate::kReplaces) {
      const Stored replaced = stored_[static_cast<std::size_t>(settled.replaced)];
      remove_sample(settled.replaced);
      if (averages) {
        average_into(slot, replaced);
      }
    }
    return settled.fate == Settled::Fate::kReplaces;
  }
  const bool was_last =
      block_count_ > 0 && blocks_[static_cast<std::size_t>(block_count_ - 1)].slot == slot;
  remove_sample(slot);
  return !was_last;
}

template <typename Real, int N, int M, int K>
bool DictionaryField<Real, N, M, K>::make_room(const Eigen::Vector3d& position_m) noexcept {
  bool moved = false;
  while (sample_count_ >= settings_.samples) {
    const int worst = least_valuable(
        stored_, transient_,
        [this](const Stored& a, const Stored& b) { return moved_m2(a, b.position_m, b.history); },
        [&](int slot, double nearest_m2) {
          const Stored& s = stored_[static_cast<std::size_t>(slot)];
          return nearest_m2 / ((s.position_m - position_m).squaredNorm() + kEvictionReach_m2) /
                 (1.0 + s.doubt_N2 / (kDoubtedNuggets * settings_.nugget_N2)) *
                 (s.from_query ? kQueryValue : 1.0) * (features_need(slot) ? kNeededValue : 1.0);
        });
    remove_sample(worst);
    moved = true;
  }
  return moved;
}

// Keeps the stiffness of the newest samples only, leaving room for one more.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::limit_stiffness() noexcept {
  int kept = 0;
  int oldest = kNone;
  for (int b = 0; b < block_count_; ++b) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    if (!block.stiffness) {
      continue;
    }
    ++kept;
    if (oldest == kNone ||
        stored_[static_cast<std::size_t>(block.slot)].order <
            stored_[static_cast<std::size_t>(blocks_[static_cast<std::size_t>(oldest)].slot)]
                .order) {
      oldest = b;
    }
  }
  if (kept >= settings_.stiffness_samples) {
    remove_block(oldest);
  }
}

// Puts an observation into a free slot.
template <typename Real, int N, int M, int K>
int DictionaryField<Real, N, M, K>::place(const Observation& o) noexcept {
  int slot = 0;
  while (stored_[static_cast<std::size_t>(slot)].used) {
    ++slot;
  }
  stored_[static_cast<std::size_t>(slot)] = {
      o.position_m,        o.force_N,  o.position_m, o.force_N,     o.history,
      o.stiffness_N_per_m, o.noise_N2, 1.0,          next_order_++, o.from_query,
      o.contact,           o.origin_W, true,         fits_closely_};
  if constexpr (K > 0) {
    terms_N_[static_cast<std::size_t>(slot)] = terms_of(o, slot);
  }
  ++sample_count_;
  return slot;
}

template <typename Real, int N, int M, int K>
Innovation DictionaryField<Real, N, M, K>::take(const Observation& o) noexcept {
  finish();
  decide_closeness();
  Innovation innovation;
  innovation.predicted = sample_count_ > 0;
  if (o.contact != contact_) {
    begin_contact(o.contact);
  }
  const double scale_before = scale_;
  if constexpr (M > 0) {
    if (scale_variance_ > kLeastScaleVariance && o.has_stiffness &&
        settings_.stiffness_samples > 0) {
      scale_by_stiffness(o);
    }
  }
  const bool scaling = scale_variance_ > kScaleKnown;
  covariances_of_force(o.position_m, o.history, x_);
  if (scaling) {
    earlier_contacts(x_.column[3]);
    x_.column[4].fill(0.0);
    x_.column[5].fill(0.0);
  }
  factor_.solve(x_, scaling ? 6 : 3);
  predicted(o, x_);
  Eigen::Vector3d mean_N = factor_.template mean<3>(x_);
  Eigen::Matrix3d covariance_N2 = Eigen::Matrix3d::Zero();
  if (innovation.predicted) {
    covariance_N2 = settings_.kernel.force_force(o.position_m, o.history, o.position_m, o.history) -
                    factor_.template explained<3>(x_);
  }
  add_features(o.position_m, o.origin_W, x_, mean_N, covariance_N2);
  Eigen::Vector3d error_N = o.force_N - mean_N;
  innovation.error_N = error_N.norm();
  const bool fresh_needed = ++takes_since_factorisation_ >= kTakesBetweenFactorisations;
  if (innovation.predicted) {
    const double noise_N2 = settings_.nugget_N2 + o.noise_N2;
    if (scaling) {
      const Eigen::Matrix3d v_N2 = innovation_covariance_N2(covariance_N2, data_scale(), noise_N2);
      scale_earlier_contacts<3>(x_, x_.column[3], v_N2, error_N);
    }
    innovation.scale = scale_ / scale_before;
    const Eigen::Matrix3d v_N2 = innovation_covariance_N2(covariance_N2, data_scale(), noise_N2);
    innovation.normalised = error_N.dot(v_N2.inverse() * error_N) / 3.0;
    innovation.likelihood_nats = -1.5 * innovation.normalised - 0.5 * std::log(v_N2.determinant());
    innovation.surprised = innovation.normalised > settings_.surprise;
    if (innovation.surprised) {
      if (seeks_explanation(o, error_N, innovation)) {
        innovation.unfinished = true;
      } else {
        finish_surprise(o, error_N, innovation);
      }
      return innovation;
    }
  }
  add(o, false, false, fresh_needed);
  return innovation;
}

// @param stale the rows that x_ was solved for have moved.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::add(const Observation& o, bool explained, bool stale,
                                         bool fresh_needed) noexcept {
  if (o.from_query) {
    for (const Stored& s : stored_) {
      if (s.used && !settings_.spacing.apart(distance_m2(s, o.position_m, o.history, o.force_N))) {
        if (fresh_needed) {
          begin_factor();
          finish_if_read();
        } else if (explained) {
          collapse();
        }
        return;
      }
    }
  } else {
    stale = settle_transient() || stale;
  }
  if (make_room(o.position_m)) {
    stale = true;
  }
  const bool with_stiffness = M > 0 && o.has_stiffness && settings_.stiffness_samples > 0;
  if (fresh_needed) {
    if (with_stiffness) {
      limit_stiffness();
    }
    begin_factor();
  }

  const int slot = place(o);
  if (!o.from_query) {
    transient_ = slot;
  }
  if (fresh_needed) {
    append_later(slot, false);
    if (with_stiffness) {
      append_later(slot, true);
    }
    finish_if_read();
    return;
  }
  append_force(slot, !stale);
  if constexpr (M > 0) {
    if (with_stiffness) {
      limit_stiffness();
      append_stiffness(slot);
    }
  }
  collapse();
}

template <typename Real, int N, int M, int K>
bool DictionaryField<Real, N, M, K>::begin_with(
    std::span<const Observation> observations) noexcept {
  for (Stored& s : stored_) {
    s.used = false;
  }
  sample_count_ = 0;
  transient_ = kNone;
  block_count_ = 0;
  blocks_due_ = 0;
  begin_factor();
  scale_ = 1.0;
  scale_variance_ = 0.0;
  for (auto o = observations.rbegin(); o != observations.rend(); ++o) {
    if (o == observations.rbegin()) {
      contact_ = o->contact;
    }
    const bool apart = std::none_of(stored_.begin(), stored_.end(), [&](const Stored& s) {
      return s.used &&
             !settings_.spacing.apart(distance_m2(s, o->position_m, o->history, o->force_N));
    });
    if (apart && sample_count_ + 1 < settings_.samples) {
      append_later(place(*o), false);
      scale_variance_ = o->contact == contact_ ? scale_variance_ : expected_scale_variance_;
    }
  }
  finish_if_read();
  return true;
}

// Solves for the weights and computes the sums that do not depend on where the field is read.
template <typename Real, int N, int M, int K>
void DictionaryField<Real, N, M, K>::collapse() noexcept {
  collapse_due_ = !reads_expected_;
  if (collapse_due_) {
    return;
  }
  solve_weights();
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::array<Eigen::Matrix3d, kHistoryFeatures> lag;
  lag.fill(Eigen::Matrix3d::Zero());
  std::size_t lane = 0;
  std::size_t few = 0;
  std::size_t row = 0;
  for (int b = 0; b < block_count_; ++b) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    const Stored& s = stored_[static_cast<std::size_t>(block.slot)];
    if (block.stiffness) {
      Eigen::Matrix3d m;
      for (std::size_t i = 0; i < 6; ++i) {
        const int r = kStiffnessRow[i];
        const int c = kStiffnessColumn[i];
        m(r, c) = m(c, r) = (r == c ? 1.0 : 0.5) * alpha_[row + i];
        few_rows_[3 + i][few] = static_cast<Real>(m(r, c));
      }
      for (std::size_t a = 0; a < 3; ++a) {
        few_rows_[a][few] = static_cast<Real>(s.position_m[static_cast<int>(a)]);
      }
      moment += m;
      ++few;
    } else {
      const Eigen::Vector3d weight(alpha_[row], alpha_[row + 1], alpha_[row + 2]);
      for (std::size_t a = 0; a < 3; ++a) {
        lane_rows_[a][lane] =
            static_cast<Real>(s.position_m[static_cast<int>(a)] / settings_.kernel.length_m);
        lane_rows_[3 + a][lane] = static_cast<Real>(weight[static_cast<int>(a)]);
      }
      moment += 0.5 * (weight * s.position_m.transpose() + s.position_m * weight.transpose());
      sum += weight;
      for (int j = 0; j < kHistoryFeatures; ++j) {
        lag[static_cast<std::size_t>(j)] += weight * s.history.col(j).transpose();
      }
      ++lane;
    }
    row += static_cast<std::size_t>(block.rows());
  }
  lanes_used_ = padded(static_cast<int>(lane), kLanePadding);
  few_lanes_used_ = padded(static_cast<int>(few), 4);
  for (; lane < static_cast<std::size_t>(lanes_used_); ++lane) {
    for (std::size_t a = 0; a < 3; ++a) {
      lane_rows_[a][lane] = Real(kFarAway_m);
      lane_rows_[3 + a][lane] = Real(0);
    }
  }
  for (; few < static_cast<std::size_t>(few_lanes_used_); ++few) {
    for (std::size_t a = 0; a < 3; ++a) {
      few_rows_[a][few] = Real(kFarAway_m);
    }
    for (std::size_t i = 0; i < 6; ++i) {
      few_rows_[3 + i][few] = Real(0);
    }
  }
  const double s2 = settings_.kernel.stiffness_variance();
  moment.diagonal().array() += moment.trace();
  linear_N_per_m_ = (s2 * moment).template cast<Real>();
  // Besides the kernel's constant, what radial_sum() leaves out.
  constant_N_ = ((settings_.kernel.constant_N2 + 1.0) * sum).template cast<Real>();
  for (std::size_t j = 0; j < kHistoryFeatures; ++j) {
    history_N_per_m_[j] = (settings_.kernel.history_variance() * lag[j]).template cast<Real>();
  }
}

template <typename Real, int N, int M, int K>
RadialTerms<Real> DictionaryField<Real, N, M, K>::radial_terms() const noexcept {
  RadialTerms<Real> terms;
  terms.sample_rows = lane_rows_[0].data();
  terms.stride = kLanes;
  terms.stiffness_rows = few_rows_[0].data();
  terms.stiffness_stride = kFewLanes;
  terms.samples = lanes_used_;
  terms.stiffness_samples = few_lanes_used_;
  terms.shape = settings_.kernel.shape;
  terms.length_m = static_cast<Real>(settings_.kernel.length_m);
  terms.inverse_length_per_m = inverse_length_per_m_;
  return terms;
}

template <typename Real, int N, int M, int K>
Reading DictionaryField<Real, N, M, K>::read(const Eigen::Vector3d& position_m,
                                             const History& history) const noexcept {
  const Eigen::Matrix<Real, 3, 1>& p = position_m.template cast<Real>();
  const RadialSum<Real> radial = radial_sum(radial_terms(), p.data());
  Eigen::Matrix<Real, 3, 1> force = constant_N_ + linear_N_per_m_ * p;
  if (settings_.kernel.history_gain > 0.0) {
    const Eigen::Matrix<Real, 3, kHistoryFeatures>& h = history.template cast<Real>();
    for (int j = 0; j < kHistoryFeatures; ++j) {
      force += history_N_per_m_[static_cast<std::size_t>(j)] * h.col(j);
    }
  }
  Reading reading;
  for (int a = 0; a < 3; ++a) {
    reading.force_N[a] = static_cast<double>(force[a] + radial.force_N[a]);
  }
  reading.nearest_m2 = static_cast<double>(radial.nearest_m2);
  return reading;
}

template <typename Real, int N, int M, int K>
Eigen::Matrix3d DictionaryField<Real, N, M, K>::stiffness_N_per_m(
    const Eigen::Vector3d& position_m, const History& /*history*/) const noexcept {
  const Eigen::Matrix<Real, 3, 1>& p = position_m.template cast<Real>();
  const RadialSlope<Real> slope = radial_slope(radial_terms(), p.data());
  Eigen::Matrix3d j = linear_N_per_m_.template cast<double>();
  add_radial_stiffness(slope, j);
  if (settings_.kernel.history_gain > 0.0) {
    for (const auto& lag : history_N_per_m_) {
      j += lag.template cast<double>();  // a sideways step is ahead of every low-passed path
    }
  }
  for (int m = 0; m < few_lanes_used_; ++m) {
    const auto lane = static_cast<std::size_t>(m);
    Eigen::Vector3d d;
    Eigen::Matrix3d weight;
    for (std::size_t a = 0; a < 3; ++a) {
      d[static_cast<int>(a)] =
          position_m[static_cast<int>(a)] - static_cast<double>(few_rows_[a][lane]);
    }
    for (std::size_t i = 0; i < 6; ++i) {
      weight(kStiffnessRow[i], kStiffnessColumn[i]) = weight(
          kStiffnessColumn[i], kStiffnessRow[i]) = static_cast<double>(few_rows_[3 + i][lane]);
    }
    const RadialDerivatives g = settings_.kernel.radial(d.squaredNorm());
    const Eigen::Vector3d along = weight * d;
    const double trace = weight.trace();
    const double quadratic = d.dot(along);
    j += 2.0 * g.g2 * weight + g.g3 * (2.0 * along * d.transpose() + 2.0 * d * along.transpose()) +
         (g.g3 * trace + g.g4 * quadratic) * d * d.transpose();
    j.diagonal().array() += g.g2 * trace + g.g3 * quadratic;
  }
  return j;
}

template <typename Real, int N, int M, int K>
double DictionaryField<Real, N, M, K>::variance_N2(const Eigen::Vector3d& position_m,
                                                   const History& history) const noexcept {
  covariances_of_force(position_m, history, x_);
  factor_.solve(x_, 3);
  double explained_N2 = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t r = 0; r < static_cast<std::size_t>(factor_.rows()); ++r) {
      explained_N2 += x_.column[c][r] * x_.column[c][r];
    }
  }
  Eigen::Vector3d mean_N = Eigen::Vector3d::Zero();
  Eigen::Matrix3d features_N2 = Eigen::Matrix3d::Zero();
  add_features(position_m, origin_W_, x_, mean_N, features_N2);
  return std::max(0.0, settings_.kernel.prior_variance_N2(position_m, history) +
                           (features_N2.trace() - explained_N2) / 3.0);
}

template <typename Real, int N, int M, int K>
double DictionaryField<Real, N, M, K>::deviation_N(const Eigen::Vector3d& position_m,
                                                   const History& history) const noexcept {
  return std::sqrt(variance_N2(position_m, history) * data_scale());
}

#ifdef FORCEGRID_SMALL_FIELDS  // for a device's own processor
template class DictionaryField<float, kSmallSamples, 0>;
#else
template class DictionaryField<float, 32, 0>;
template class DictionaryField<double, 32, 0>;
template class DictionaryField<double, 32, 0, 1>;
template class DictionaryField<double, 32, 0, kPathTerms>;
template class DictionaryField<float, 32, 4>;
template class DictionaryField<float, 32, 4, kMotionTerms>;
template class DictionaryField<double, 32, 4>;
template class DictionaryField<float, 48, 0>;
template class DictionaryField<double, 48, 0>;
#endif

}  // namespace forcegrid::kriging
