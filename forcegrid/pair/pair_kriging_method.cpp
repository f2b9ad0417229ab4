// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_kriging_method.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {
namespace {

constexpr double kNoScore = -1.0;

double smoothstep(double t) noexcept { return t * t * (3.0 - 2.0 * t); }

}  // namespace

PairKrigingMethod::PairKrigingMethod(const char* name,
                                     std::span<const pair::PairFieldSettings> candidates)
    : name_(name), scores_N2_(candidates.size(), kNoScore) {
  fields_.reserve(candidates.size());
  for (const pair::PairFieldSettings& settings : candidates) {
    fields_.emplace_back(settings);
    plain_count_ += settings.stiffness_samples > 0 ? 0 : 1;
  }
  render_first();
}

std::size_t PairKrigingMethod::memory_bytes() const noexcept {
  return sizeof(*this) + fields_.capacity() * sizeof(pair::PairField) +
         scores_N2_.capacity() * sizeof(double);
}

void PairKrigingMethod::take_sample(const PairSample& sample) noexcept {
  if (!in_contact_ || !std::isfinite(sample.time_s) || !sample.positions_W.allFinite() ||
      !sample.forces_W.allFinite() || sample.time_s < newest_s_) {
    return;
  }
  newest_s_ = sample.time_s;
  if (queued_ - next_ == kQueue) {
    ++next_;
    ++counters_[0].value;
  }
  queue_[queued_++ % kQueue] = {sample.positions_W - points_W_, sample.forces_W,
                                sample.has_stiffness && sample.stiffness_W.allFinite(),
                                sample.stiffness_W};
}

void PairKrigingMethod::contacts_made(std::uint32_t /*epoch*/,
                                      const PairVector& points_W) noexcept {
  known_ = true;
  in_contact_ = true;
  points_W_ = points_W;
  for (pair::PairField& field : fields_) {
    field.clear();
  }
  std::fill(scores_N2_.begin(), scores_N2_.end(), kNoScore);
  render_first();
  next_ = queued_;
  taking_ = stiffness_seen_ = any_taken_ = false;
  compared_ = 0;
  log_ratio_ = 0.0;
  left_N_.setZero();
}

void PairKrigingMethod::contacts_lost() noexcept {
  known_ = true;
  in_contact_ = false;
}

int PairKrigingMethod::work(int budget) noexcept {
  int done = 0;
  while (done < budget) {
    const int units = piece();
    if (units == 0) {
      break;
    }
    done += units;
  }
  return done;
}

// @returns the units of the piece that was done; 0 if nothing was left.
int PairKrigingMethod::piece() noexcept {
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    pair::PairField& field = fields_[i];
    if (field.ready()) {
      continue;
    }
    field.prepare();
    int units = 1 + field.row_count() * field.row_count() / 8;
    // Two pieces of a field without stiffness are still less than one of a field with it.
    if (stiffness_seen_ && !takes_stiffness(i) && field.prepare()) {
      units *= 2;
    }
    return units;
  }
  if (taking_) {
    finish_sample();
    return 1;
  }
  if (chosen_ != rendered_) {
    hand_over();
    return 1;
  }
  if (next_ == queued_ || !in_contact_) {
    return 0;
  }
  const Queued& next = queue_[next_++ % kQueue];
  if (next.has_stiffness && !stiffness_seen_) {
    see_stiffness();
  }
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    if (awake(i)) {
      fields_[i].begin(next.positions_m, next.forces_N,
                       next.has_stiffness ? &next.stiffness_N_per_m : nullptr);
    }
  }
  taking_ = any_taken_ = true;
  return 1;
}

// The fields with stiffness as data wake.
void PairKrigingMethod::see_stiffness() noexcept {
  stiffness_seen_ = true;
  if (!any_taken_ && plain_count_ < fields_.size()) {
    fields_[rendered_].expect_reads(false);
    rendered_ = chosen_ = stiff_;
    fields_[rendered_].expect_reads(true);
  }
}

void PairKrigingMethod::finish_sample() noexcept {
  taking_ = false;
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    const pair::PairInnovation& innovation = fields_[i].innovation();
    if (!awake(i) || !innovation.predicted) {
      continue;
    }
    const double error_N2 = innovation.error_N * innovation.error_N;
    scores_N2_[i] =
        scores_N2_[i] < 0.0 ? error_N2 : scores_N2_[i] + kNewest * (error_N2 - scores_N2_[i]);
  }
  choose();
}

// Moves `preferred`, one of the fields from `first` to `end`, to one with a better score.
void PairKrigingMethod::prefer_better(std::size_t first, std::size_t end,
                                      std::size_t& preferred) const noexcept {
  std::size_t best = preferred;
  for (std::size_t i = first; i < end; ++i) {
    if (scores_N2_[i] >= 0.0 && scores_N2_[i] < scores_N2_[best]) {
      best = i;
    }
  }
  if (scores_N2_[best] < kBetter * scores_N2_[preferred]) {
    preferred = best;
  }
}

void PairKrigingMethod::choose() noexcept {
  prefer_better(0, plain_count_, plain_);
  prefer_better(plain_count_, fields_.size(), stiff_);
  bool renders_stiff = rendered_ >= plain_count_;
  const bool has_both = plain_count_ > 0 && plain_count_ < fields_.size();
  if (has_both && scores_N2_[plain_] >= 0.0 && scores_N2_[stiff_] >= 0.0) {
    const auto error_N2 = [this](std::size_t field) {
      const double error_N = fields_[field].innovation().error_N;
      return error_N * error_N + kLeastError_N * kLeastError_N;
    };
    // The first prediction of a field without stiffness is of one sample: the same force again.
    const bool first = compared_++ == 0 && fields_[plain_].innovation().error_N > kChanged_N;
    const double expected = first ? 2.0 * std::log(kFirstBetter) : 0.0;
    log_ratio_ += std::max(kNewest, 1.0 / compared_) *
                  (std::log(error_N2(stiff_) / error_N2(plain_)) + expected - log_ratio_);
    if (renders_stiff) {
      renders_stiff =
          -log_ratio_ > std::log(kBetter) && kBetter * scores_N2_[stiff_] < scores_N2_[plain_];
    } else {
      renders_stiff = log_ratio_ < std::log(kBetter) && scores_N2_[stiff_] < scores_N2_[plain_];
    }
  }
  const std::size_t best = renders_stiff ? stiff_ : plain_;
  if (best != rendered_) {
    chosen_ = best;
    fields_[best].expect_reads(true);
  }
}

// The chosen candidate can be read.
void PairKrigingMethod::hand_over() noexcept {
  const PairVector before_N = fields_[rendered_].read(now_m_).forces_N + fading_N(now_s_);
  left_N_ = before_N - fields_[chosen_].read(now_m_).forces_N;
  changed_s_ = now_s_;
  fields_[rendered_].expect_reads(false);
  rendered_ = chosen_;
  ++counters_[1].value;
}

// Only the rendered field needs its weights.
void PairKrigingMethod::render_first() noexcept {
  plain_ = rendered_ = chosen_ = 0;
  stiff_ = plain_count_ < fields_.size() ? plain_count_ : 0;
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    fields_[i].expect_reads(i == rendered_);
  }
}

PairVector PairKrigingMethod::fading_N(double time_s) const noexcept {
  return left_N_ * std::exp(-std::max(0.0, time_s - changed_s_) / kFade_s);
}

void PairKrigingMethod::observe(double time_s, const PairVector& positions_W) noexcept {
  if (std::isfinite(time_s) && positions_W.allFinite()) {
    now_s_ = time_s;
    now_m_ = positions_W - points_W_;
  }
}

PairEstimate PairKrigingMethod::forces(double time_s,
                                       const PairVector& positions_W) const noexcept {
  PairEstimate estimate;
  if (!std::isfinite(time_s) || !positions_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  const pair::PairField& field = fields_[rendered_];
  if (!in_contact_ || !field.readable()) {
    estimate.status = known_ && !in_contact_ ? EstimateStatus::kOk : EstimateStatus::kUnknown;
    return estimate;
  }
  const pair::PairField::Reading reading = field.read(positions_W - points_W_);
  if (!(reading.nearest_m < kUnknown_m)) {
    return estimate;
  }
  const double beyond = std::max(0.0, reading.nearest_m - kFade_m) / (kUnknown_m - kFade_m);
  estimate.forces_W = smoothstep(1.0 - beyond) * (reading.forces_N + fading_N(time_s));
  estimate.status = beyond > 0.0 ? EstimateStatus::kPartlyKnown : EstimateStatus::kOk;
  if (!estimate.forces_W.allFinite()) {
    estimate.forces_W.setZero();
    estimate.status = EstimateStatus::kNotFinite;
  }
  return estimate;
}

}  // namespace forcegrid
