// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/pair_half.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "rt/vectors.h"

namespace forcegrid::servo {
namespace {

bool known(EstimateStatus status) noexcept {
  return status == EstimateStatus::kOk || status == EstimateStatus::kPartlyKnown;
}

// Whether a sample has what it takes for its tool's half of the stiffness of both.
bool tells_stiffness(const Sample& own, const Sample& other) noexcept {
  return own.has_stiffness && own.has_influence &&
         (own.other_position_W - other.position_W).norm() <= PairHalf::kSamePlace_m;
}

Eigen::Vector3d or_else(const Eigen::Vector3d& wanted, const Eigen::Vector3d& otherwise) noexcept {
  return wanted.allFinite() ? wanted : otherwise;
}

}  // namespace

bool PairHalf::Pending::add(const Sample& sample) noexcept {
  const bool lost = std::exchange(waits[next], true);
  samples[next] = sample;
  next = (next + 1) % kPending;
  return lost;
}

PairHalf::PairHalf(std::unique_ptr<PairForceMethod> both, std::unique_ptr<ForceMethod> alone,
                   PairExchange& exchange, std::size_t tool)
    : both_(std::move(both)),
      alone_(std::move(alone)),
      exchange_(exchange),
      tool_(tool),
      names_{both_->name(), alone_->name()} {
  constexpr const char* kNames[kOwnCounters] = {
      "cycles_both_tools", "cycles_other_off",    "cycles_other_late",
      "cycles_learning",   "returns_to_one_tool", "samples_paired",
      "samples_unpaired",  "samples_untold",      "samples_with_stiffness"};
  for (const char* name : kNames) {
    counters_[counter_count_++] = {name, 0};
  }
  for (const NamedCounter& counter : both_->counters()) {
    if (counter_count_ < kMostCounters) {
      counters_[counter_count_++] = counter;
    }
  }
}

std::size_t PairHalf::memory_bytes() const noexcept {
  return sizeof(*this) + both_->memory_bytes() + alone_->memory_bytes();
}

PairMatrix PairHalf::stiffness_W(const Sample& mine, const Sample& theirs) const noexcept {
  const auto own = static_cast<Eigen::Index>(3 * tool_);
  const auto other = static_cast<Eigen::Index>(3 * (1 - tool_));
  PairMatrix of_both;
  of_both.block<3, 3>(own, own) = mine.stiffness_W;
  of_both.block<3, 3>(own, other) = mine.influence_W;
  of_both.block<3, 3>(other, own) = theirs.influence_W;
  of_both.block<3, 3>(other, other) = theirs.stiffness_W;
  return of_both;
}

PairVector PairHalf::both(const Eigen::Vector3d& own, const Eigen::Vector3d& other) const noexcept {
  PairVector of_both;
  of_both.segment<3>(static_cast<Eigen::Index>(3 * tool_)) = own;
  of_both.segment<3>(static_cast<Eigen::Index>(3 * (1 - tool_))) = other;
  return of_both;
}

Eigen::Vector3d PairHalf::own(const PairVector& of_both) const noexcept {
  return of_both.segment<3>(static_cast<Eigen::Index>(3 * tool_));
}

PairVector PairHalf::positions_W(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  const double ahead_s = std::clamp(time_s - other_.time_s, -kMostAhead_s, kMostAhead_s);
  return both(position_W, rt::to_vector(other_.position_W_m) +
                              ahead_s * rt::to_vector(other_.velocity_W_m_per_s));
}

void PairHalf::take_sample(const Sample& sample) noexcept {
  alone_->take_sample(sample);
  if (sample.from_query || !in_contact_) {
    return;
  }
  count(kUnpaired) += mine_.add(sample) && both_hold_ ? 1 : 0;
  count(kUntold) += exchange_.tell(tool_, sample) ? 0 : 1;
  unmatched_news_ = true;
}

void PairHalf::contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept {
  keep_force();
  alone_->contact_made(epoch, point_W);
  in_contact_ = true;
  epoch_ = epoch;
  point_W_ = point_W;
  mine_.clear();
}

void PairHalf::contact_lost() noexcept {
  alone_->contact_lost();
  in_contact_ = false;
  weight_ = held_share_ = 0.0;
  rendered_both_ = false;
  mine_.clear();
}

void PairHalf::expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
  alone_->expect_contact(time_s, point_W);
}

int PairHalf::work(int budget) noexcept {
  const int alone = alone_->work(std::max(1, budget / 2));
  const int both = both_->work(std::max(1, budget - std::max(alone, budget / 2)));
  const auto of_both = both_->counters();
  std::copy_n(of_both.begin(), counter_count_ - kOwnCounters, counters_.begin() + kOwnCounters);
  return alone + both;
}

void PairHalf::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  alone_->observe(time_s, position_W);
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    return;
  }
  const double elapsed_s = observed_ ? std::max(0.0, time_s - time_s_) : 0.0;
  tell_place(time_s, position_W);
  take_news();
  renew_contacts(position_W);
  match();
  if (both_hold_) {
    both_->observe(time_s, positions_W(time_s, position_W));
  }
  move_weights(time_s, elapsed_s, position_W);
  time_s_ = time_s;
  position_W_ = position_W;
  observed_ = true;
}

void PairHalf::tell_place(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (const double elapsed_s = time_s - time_s_; observed_ && elapsed_s >= kShortest_s) {
    const Eigen::Vector3d mean_W = (position_W - position_W_) / elapsed_s;
    velocity_W_m_per_s_ =
        elapsed_s_ > 0.0 ? end_velocity(mean_W, elapsed_s, mean_velocity_W_m_per_s_, elapsed_s_)
                         : mean_W;
    mean_velocity_W_m_per_s_ = mean_W;
    elapsed_s_ = elapsed_s;
  }
  exchange_.publish(tool_, {.time_s = time_s,
                            .position_W_m = rt::to_array(position_W),
                            .velocity_W_m_per_s = rt::to_array(velocity_W_m_per_s_),
                            .in_contact = in_contact_,
                            .contact_epoch = epoch_,
                            .contact_point_W_m = rt::to_array(or_else(point_W_, position_W))});
}

// The pair method is about to forget: what was felt last is faded from.
void PairHalf::keep_force() noexcept {
  if (weight_ > 0.0) {
    held_W_ = rendered_W_;
    held_share_ = 1.0;
    weight_ = 0.0;
  }
}

// The samples first: a contact that they belong to is then in the place, or in the next one.
void PairHalf::take_news() noexcept {
  Sample sample;
  for (int i = 0; i < PairExchange::kSamples && exchange_.hear(tool_, sample); ++i) {
    theirs_.add(sample);
    unmatched_news_ = true;
  }
  PairPlace place = other_;
  if (!exchange_.fetch(tool_, place)) {
    return;
  }
  if (place.in_contact != other_.in_contact || place.contact_epoch != other_.contact_epoch) {
    keep_force();
    unmatched_news_ = true;
  }
  other_ = place;
  other_known_ = true;
}

void PairHalf::renew_contacts(const Eigen::Vector3d& position_W) noexcept {
  const bool hold = in_contact_ && other_known_ && other_.in_contact;
  if (!hold) {
    if (both_hold_) {
      both_->contacts_lost();
    }
    both_hold_ = false;
  } else if (!both_hold_ || own_epoch_of_both_ != epoch_ ||
             other_epoch_of_both_ != other_.contact_epoch) {
    both_->contacts_made(++pair_epoch_, both(or_else(point_W_, position_W),
                                             rt::to_vector(other_.contact_point_W_m)));
    both_hold_ = true;
    own_epoch_of_both_ = epoch_;
    other_epoch_of_both_ = other_.contact_epoch;
  }
}

void PairHalf::match() noexcept {
  if (!unmatched_news_ || !both_hold_) {
    return;
  }
  unmatched_news_ = false;
  for (std::size_t k = 0; k < kPending; ++k) {  // the oldest first: it is next to be replaced
    const std::size_t i = (mine_.next + k) % kPending;
    const Sample& mine = mine_.samples[i];
    if (!mine_.waits[i] || mine.solution == 0 || mine.contact_epoch != epoch_) {
      continue;
    }
    for (std::size_t j = 0; j < kPending; ++j) {
      const Sample& theirs = theirs_.samples[j];
      if (theirs_.waits[j] && theirs.solution == mine.solution &&
          theirs.contact_epoch == other_.contact_epoch &&
          std::abs(theirs.time_s - mine.time_s) <= kTogether_s) {
        take_pair(mine, theirs);
        mine_.waits[i] = theirs_.waits[j] = false;
        break;
      }
    }
  }
}

void PairHalf::take_pair(const Sample& mine, const Sample& theirs) noexcept {
  ++count(kPaired);
  PairSample pair;
  pair.time_s = std::max(mine.time_s, theirs.time_s);
  pair.positions_W = both(mine.position_W, theirs.position_W);
  pair.forces_W = both(mine.force_W, theirs.force_W);
  pair.has_stiffness = tells_stiffness(mine, theirs) && tells_stiffness(theirs, mine);
  if (pair.has_stiffness) {
    ++count(kWithStiffness);
    pair.stiffness_W = stiffness_W(mine, theirs);
  }
  pair.contact_epoch = pair_epoch_;
  pair.contact_points_W = both(mine.contact_point_W, theirs.contact_point_W);
  pair.relative_residual = std::max(mine.relative_residual, theirs.relative_residual);
  pair.converged = mine.converged && theirs.converged;
  both_->take_sample(pair);
}

void PairHalf::move_weights(double time_s, double elapsed_s,
                            const Eigen::Vector3d& position_W) noexcept {
  const bool fresh = both_hold_ && time_s - other_.time_s <= kOld_s;
  PairEstimate of_both;
  if (both_hold_) {
    of_both = both_->forces(time_s, positions_W(time_s, position_W));
  }
  const bool answers = both_hold_ && known(of_both.status);
  if (!answers) {
    keep_force();
  }
  held_share_ = std::max(0.0, held_share_ - elapsed_s / kHandOver_s);
  if (fresh && answers) {
    weight_ = held_share_ > 0.0 ? weight_ : std::min(1.0, weight_ + elapsed_s / kRise_s);
  } else {
    weight_ = std::max(0.0, weight_ - elapsed_s / kFade_s);
  }
  if (weight_ > 0.0) {
    rendered_W_ = mixed(alone_->force(time_s, position_W), of_both).force_W;
  }
  if (!in_contact_) {
    return;
  }
  if (weight_ >= 0.5) {
    ++count(kCyclesBoth);
  } else if (!both_hold_) {
    ++count(kCyclesOtherOff);
  } else if (!fresh) {
    ++count(kCyclesOtherLate);
  } else {
    ++count(kCyclesLearning);
  }
  count(kReturns) += rendered_both_ && weight_ < 0.5 ? 1 : 0;
  rendered_both_ = weight_ >= 0.5;
}

ForceEstimate PairHalf::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  const ForceEstimate alone = alone_->force(time_s, position_W);
  return mixed(alone, weight_ > 0.0 && alone.status != EstimateStatus::kNotFinite
                          ? both_->forces(time_s, positions_W(time_s, position_W))
                          : PairEstimate{});
}

ForceEstimate PairHalf::mixed(ForceEstimate estimate, const PairEstimate& of_both) const noexcept {
  estimate.candidate = kAlone;
  estimate.reason = ChoiceReason::kOneTool;
  if (estimate.status == EstimateStatus::kNotFinite || (weight_ <= 0.0 && held_share_ <= 0.0)) {
    return estimate;
  }
  estimate.uncertainty_N = std::numeric_limits<double>::quiet_NaN();
  if (weight_ > 0.0 && known(of_both.status)) {
    estimate.force_W += weight_ * (own(of_both.forces_W) - estimate.force_W);
    estimate.status = weight_ >= 0.5 ? of_both.status : estimate.status;
  }
  if (weight_ >= 0.5) {
    estimate.candidate = kBoth;
    estimate.reason = ChoiceReason::kBothTools;
  }
  estimate.force_W += held_share_ * (held_W_ - estimate.force_W);
  if (!known(estimate.status) && !estimate.force_W.isZero(0.0)) {
    estimate.status = EstimateStatus::kPartlyKnown;
  }
  return estimate;
}

}  // namespace forcegrid::servo
