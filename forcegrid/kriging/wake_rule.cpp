// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/wake_rule.h"

#include <algorithm>

namespace forcegrid::kriging {

WakeRule::WakeRule(const Candidates& candidates, const EnsembleThresholds& thresholds,
                   bool enabled) noexcept
    : candidates_(candidates),
      thresholds_(thresholds),
      enabled_(enabled),
      misfit_(thresholds.misfit_nats) {}

void WakeRule::sample_queued(std::uint64_t number, const QueuedSample& sample,
                             double since_contact_s, std::size_t rendered) noexcept {
  queued_ = number + 1;
  rendered_ = rendered;
  last_rendered_[rendered] = queued_;
  contact_begins_ = sample.before_contact || since_contact_s < thresholds_.places_learn_s;
  unfinished_for_ =
      sample.unfinished ? thresholds_.awake_samples : std::max(0, unfinished_for_ - 1);
  if (enabled_ && !all_awake_ && !sample.observation.from_query) {
    audition();
  }
}

void WakeRule::audition() noexcept {
  if (--until_audition_ > 0) {
    return;
  }
  const bool ends = auditioned_ != Candidates::kNone;
  auditioned_ = ends                                                         ? Candidates::kNone
                : runner_up_ != rendered_ && runner_up_ != Candidates::kNone ? runner_up_
                : rendered_ == candidates_.memory                            ? candidates_.alone
                                                                             : candidates_.memory;
  if (ends) {
    until_audition_ = next_audition_;
    next_audition_ = std::min(2 * next_audition_, thresholds_.longest_audition_pause);
  } else {
    until_audition_ = thresholds_.audition_samples;
  }
}

void WakeRule::rendered_took(const Innovation& innovation) noexcept {
  if (!enabled_ || !innovation.predicted) {
    return;
  }
  patience_ = std::max(0, patience_ - 1);
  double normalised = innovation.normalised;
  if (!(normalised > 0.0)) {  // a field that states no variance: its errors so far
    const Candidate& candidate = *candidates_.all[rendered_];
    normalised = innovation.error_N * innovation.error_N /
                 (3.0 * candidate.field().settings().nugget_N2 + candidate.long_score_N2);
  }
  misfit_.add(innovation.error_N < thresholds_.good_enough_N ? 0.0 : normalised);
  if (all_awake_) {
    return;
  }
  if (misfit_.found() && patience_ == 0) {
    all_awake_ = true;
    auditioned_ = Candidates::kNone;
    changed_ = false;
    since_change_ = 0;
    misfit_.restart();
  } else if (innovation.surprised) {
    walls_until_ = queued_ + static_cast<std::uint64_t>(thresholds_.walls_awake);
  }
}

void WakeRule::scored(const CandidateChoice& choice) noexcept {
  ++scored_;
  ++since_change_;
  if (enabled_ && all_awake_ && since_change_ >= thresholds_.awake_samples &&
      scored_ >= thresholds_.warm_samples && !specialist_lately()) {
    all_sleep(choice);
  }
}

// A misfit that nobody could mend is not looked at again at once.
void WakeRule::all_sleep(const CandidateChoice& choice) noexcept {
  next_patience_ = changed_ ? 0
                            : std::clamp(2 * next_patience_, thresholds_.awake_samples,
                                         thresholds_.longest_patience);
  patience_ = next_patience_;
  runner_up_ = choice.runner_up(rendered_);
  all_awake_ = false;
  auditioned_ = Candidates::kNone;
  until_audition_ = next_audition_ = thresholds_.audition_pause;
  misfit_.restart();
}

void WakeRule::handed_over(std::size_t rendered) noexcept {
  rendered_ = rendered;
  changed_ = true;
  since_change_ = 0;
  misfit_.restart();
}

void WakeRule::contact_made() noexcept {
  contact_begins_ = true;
  if (auditioned_ == Candidates::kNone) {
    until_audition_ = 1;  // the place may be known from long ago
  }
  next_audition_ = thresholds_.audition_pause;
}

bool WakeRule::rendered_lately(std::size_t index) const noexcept {
  return last_rendered_[index] != 0 &&
         queued_ <= last_rendered_[index] + static_cast<std::uint64_t>(thresholds_.lately);
}

bool WakeRule::specialist_lately() const noexcept {
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (i != candidates_.places && candidates_.all[i]->weight() > 1.0 && rendered_lately(i)) {
      return true;
    }
  }
  return false;
}

bool WakeRule::awake(std::size_t index) const noexcept {
  if (all_awake_ || index == rendered_ || index == auditioned_) {
    return true;
  }
  if (index == candidates_.memory) {
    return false;
  }
  if (index == candidates_.places) {
    return contact_begins_;
  }
  return rendered_lately(index) || (index == candidates_.unfinished && unfinished_for_ > 0) ||
         (index == candidates_.walls &&
          (queued_ < walls_until_ || candidates_.all[index]->field().knows_walls()));
}

}  // namespace forcegrid::kriging
