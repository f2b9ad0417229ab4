// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/wake_rule.h"

#include <algorithm>
#include <cmath>

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
  if (!candidates_.all[rendered]->knows_path()) {
    last_rendered_[rendered] = queued_;
  }
  unchosen_ = chosen_ ? unchosen_ : queued_;
  contact_begins_ =
      sample.before_contact || (places_asked_ && since_contact_s < thresholds_.places_learn_s);
  places_learn_ = !sample.before_contact && since_contact_s < 2.0 * thresholds_.places_learn_s;
  unfinished_for_ = sample.observation.unfinished ? thresholds_.unfinished_samples
                                                  : std::max(0, unfinished_for_ - 1);
  if (enabled_ && !all_awake_ && !sample.observation.from_query) {
    audition();
  }
}

void WakeRule::audition() noexcept {
  if (--until_audition_ > 0) {
    return;
  }
  if (auditioned_ != Candidates::kNone) {
    auditioned_ = Candidates::kNone;
    until_audition_ = next_audition_;
    next_audition_ = std::min(2 * next_audition_, thresholds_.longest_audition_pause);
    return;
  }
  auditioned_ = whom_to_audition();
  until_audition_ =
      audition_at_contact_ ? thresholds_.contact_audition_samples : thresholds_.audition_samples;
  audition_at_contact_ = false;
}

std::size_t WakeRule::whom_to_audition() const noexcept {
  const Candidate& rendered = *candidates_.all[rendered_];
  const bool less_noise_may_do = rendered_ != candidates_.alone &&
                                 candidates_.is_general(rendered_) &&
                                 rendered.long_score_N2 < rendered.field().settings().nugget_N2;
  if (less_noise_may_do && !audition_at_contact_) {
    return candidates_.alone;
  }
  if (!audition_at_contact_ && runner_up_ != rendered_ && runner_up_ != Candidates::kNone) {
    return runner_up_;
  }
  return rendered_ == candidates_.memory ? candidates_.alone : candidates_.memory;
}

// The tool may be back at a place that `memory` has kept, unless there was an event lately. Where a
// contact begins and `places` is asked, that is for it. A deviation no larger than the candidate's
// recent errors shows that samples are noisy, wherever the tool is.
bool WakeRule::rendered_deviates(double deviation_N) noexcept {
  const double errs_N = std::sqrt(candidates_.all[rendered_]->long_score_N2);
  const bool unsure = deviation_N > std::max(thresholds_.unsure_N, errs_N);
  const bool event = all_awake_ || woken_lately();
  const bool begins = contact_begins_ || rendered_ == candidates_.places;
  const bool asked = queued_ < asked_until_ || rendered_ == candidates_.memory ||
                     auditioned_ == candidates_.memory;
  if (!enabled_ || !unsure || event || begins || asked) {
    return false;
  }
  auditioned_ = candidates_.memory;
  until_audition_ = thresholds_.audition_samples;
  asked_until_ = queued_ + static_cast<std::uint64_t>(thresholds_.audition_samples +
                                                      thresholds_.audition_pause);
  return true;
}

void WakeRule::rendered_took(const Innovation& innovation) noexcept {
  if (!enabled_ || !innovation.predicted) {
    return;
  }
  double normalised = innovation.normalised;
  if (!(normalised > 0.0)) {  // a field that states no variance: its errors so far
    const Candidate& candidate = *candidates_.all[rendered_];
    normalised = innovation.error_N * innovation.error_N /
                 (3.0 * candidate.field().settings().nugget_N2 + candidate.long_score_N2);
  }
  misfit_.add(innovation.error_N < thresholds_.good_enough_N ? 0.0 : normalised);
  const bool somebody_sleeps =
      !all_awake_ || std::find(hopeless_.begin(), hopeless_.end(), true) != hopeless_.end();
  if (misfit_.found() && somebody_sleeps) {
    wake_all();
  } else if (innovation.surprised) {
    walls_until_ = queued_ + static_cast<std::uint64_t>(thresholds_.walls_awake);
  }
}

void WakeRule::rendered_had_no_use() noexcept {
  if (enabled_ && !all_awake_) {
    wake_all();
  }
}

void WakeRule::wake_all() noexcept {
  all_awake_ = true;
  all_woken_ = queued_;
  path_explained_ = path_explained_lately();
  auditioned_ = Candidates::kNone;
  restart_sums();
  worse_.fill(0.0);
  hopeless_.fill(false);
  misfit_.restart();
}

void WakeRule::restart_sums() noexcept {
  awake_for_ = 0;
  chosen_N2_ = 0.0;
  alone_N2_.fill(0.0);
}

void WakeRule::evaluated(const EvaluatedSample& sample) noexcept {
  const double good_enough_N2 = thresholds_.good_enough_N * thresholds_.good_enough_N;
  // Where a first touch is not known well `places` helps, which wakes by itself.
  const bool unknown = sample.first_touch && !(sample.error_N2[rendered_] <= good_enough_N2);
  if (!enabled_ || unknown || rendered_ == candidates_.places) {
    return;
  }
  const auto error_N2 = [&](std::size_t index) {
    const double own_N2 = sample.error_N2[index];
    const double taken_N2 =
        own_N2 == EvaluatedSample::kNotTaken_N2 ? sample.error_N2[rendered_] : own_N2;
    return taken_N2 == EvaluatedSample::kNotTaken_N2 ? good_enough_N2
                                                     : std::max(good_enough_N2, taken_N2);
  };
  ++awake_for_;
  const double kept = thresholds_.regret_kept;
  const double rendered_N2 = error_N2(rendered_);
  chosen_N2_ = kept * chosen_N2_ + rendered_N2;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const double own_N2 = hopeless_[i] ? thresholds_.hopeless * rendered_N2 : error_N2(i);
    alone_N2_[i] = kept * alone_N2_[i] + own_N2;
    if (!all_awake_) {
      continue;  // nobody is hopeless then
    }
    const double twice = std::log(own_N2 / rendered_N2) / std::log(4.0);
    worse_[i] = kept * worse_[i] + (1.0 - kept) * std::clamp(twice, -1.0, 1.0);
  }
}

bool WakeRule::scored(const CandidateChoice& choice) noexcept {
  stays_ = rendered_;
  if (!enabled_) {
    return false;
  }
  // Where others are good enough, and at first, who knows the path is better by luck, and explains
  // nothing.
  const Peers peers = choice.peers();
  if (candidates_.all[rendered_]->knows_path() && peers.long_scored >= thresholds_.long_enough &&
      peers.general_long_score_N2 > thresholds_.path_wrong_N2) {
    last_rendered_[rendered_] = queued_;
  }
  if (!all_awake_) {
    return dismiss_kept();
  }
  if (rendered_suffices(staying())) {
    all_sleep(choice);
    return true;
  }
  // Away from a wall others may be right again.
  return awake_for_ >= thresholds_.hopeless_samples &&
         !rendered_within(candidates_.walls, thresholds_.path_lately) && hopeless_sleep();
}

// The best of those that know the position alone.
std::size_t WakeRule::best_general() const noexcept {
  std::size_t best = Candidates::kNone;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (candidates_.is_general(i) && !hopeless_[i] &&
        (best == Candidates::kNone || alone_N2_[i] < alone_N2_[best])) {
      best = i;
    }
  }
  return best;
}

bool WakeRule::hopeless_sleep() noexcept {
  bool slept = false;
  const std::size_t general = best_general();
  const double full = 1.0 - std::pow(thresholds_.regret_kept, awake_for_);
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const bool needed = i == rendered_ || i == general || i == candidates_.newest ||
                        rendered_within(i, thresholds_.path_lately);
    if (!needed && alone_N2_[i] > thresholds_.hopeless * alone_N2_[rendered_] &&
        worse_[i] > thresholds_.hopeless_share * full) {
      slept = slept || !hopeless_[i];
      hopeless_[i] = true;
    }
  }
  return slept;
}

// Whether the rendered candidate alone would have done as well as all together, and no other one
// alone better. More samples have to show that if `stays` is a specialist.
bool WakeRule::rendered_suffices(std::size_t stays) const noexcept {
  const bool special = candidates_.all[stays]->weight() > 1.0;
  if (awake_for_ < (special ? thresholds_.specialist_samples : thresholds_.awake_samples) ||
      alone_N2_[rendered_] > thresholds_.regret * chosen_N2_ || path_explained_lately()) {
    return false;
  }
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (candidates_.all[i]->weight() * alone_N2_[i] < alone_N2_[rendered_] && i != rendered_) {
      return false;
    }
  }
  return true;
}

// After an event, others may be needed at the next one.
bool WakeRule::dismiss_kept() noexcept {
  if (woken_lately() || !rendered_suffices(rendered_)) {
    return false;
  }
  bool slept = false;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (i != rendered_ && kept_lately(i)) {
      dismissed_[i] = queued_;
      slept = true;
    }
  }
  if (slept) {
    restart_sums();
  }
  return slept;
}

// Of those that are hardly worse than the rendered one, that which assumes the least noise: it will
// learn most from samples to come.
std::size_t WakeRule::staying() const noexcept {
  const double kept = thresholds_.regret_kept;
  const double samples = (1.0 - std::pow(kept, awake_for_)) / (1.0 - kept);
  const double most_N2 =
      alone_N2_[rendered_] + samples * thresholds_.as_good_N * thresholds_.as_good_N;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (candidates_.is_general(i) && !hopeless_[i] && alone_N2_[i] <= most_N2) {
      return i;
    }
  }
  return rendered_;
}

void WakeRule::all_sleep(const CandidateChoice& choice) noexcept {
  stays_ = staying();
  runner_up_ = choice.runner_up(stays_);
  chosen_ = true;
  all_awake_ = false;
  hopeless_.fill(false);
  auditioned_ = Candidates::kNone;
  audition_at_contact_ = false;
  until_audition_ = next_audition_ = thresholds_.audition_pause;
  misfit_.restart();
  restart_sums();
}

void WakeRule::handed_over(std::size_t rendered) noexcept {
  rendered_ = rendered;
  chosen_ = true;
  ask_places_.won = ask_places_.won || rendered == candidates_.places;
  ask_memory_.won = ask_memory_.won || rendered == candidates_.memory;
  awake_for_ = all_awake_ ? awake_for_ : 0;
  misfit_.restart();
  if (enabled_ && !all_awake_ && rendered == candidates_.newest) {
    wake_all();  // nobody who is awake knows the object
  }
}

bool WakeRule::AskedAtContact::next(int longest_pause) noexcept {
  if (--until > 0 && !won) {
    return false;
  }
  pause = won ? 1 : std::min(2 * pause, longest_pause);
  until = pause;
  won = false;
  return true;
}

void WakeRule::contact_made() noexcept {
  places_asked_ = ask_places_.next(thresholds_.longest_contact_pause);
  contact_begins_ = places_asked_;
  places_learn_ = true;
  // The place may be known from long ago.
  if (ask_memory_.next(thresholds_.longest_contact_pause) && auditioned_ == Candidates::kNone) {
    until_audition_ = 1;
    audition_at_contact_ = true;
  }
}

bool WakeRule::woken_lately() const noexcept {
  return woken() && queued_ <= all_woken_ + static_cast<std::uint64_t>(thresholds_.lately);
}

bool WakeRule::rendered_within(std::size_t index, int samples) const noexcept {
  return last_rendered_[index] != 0 &&
         queued_ <= last_rendered_[index] + static_cast<std::uint64_t>(samples);
}

// The one that began was rendered before any was scored. That alone is no reason to stay awake, but
// specialists and others that stay are compared with it.
bool WakeRule::kept_lately(std::size_t index) const noexcept {
  if (!rendered_within(index, thresholds_.lately) || last_rendered_[index] <= dismissed_[index]) {
    return false;
  }
  if (last_rendered_[index] > unchosen_ || candidates_.all[rendered_]->weight() > 1.0) {
    return true;
  }
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const bool stays = i != rendered_ && i != candidates_.memory && i != candidates_.places;
    if (stays && last_rendered_[i] > unchosen_ && rendered_within(i, thresholds_.lately)) {
      return true;
    }
  }
  return false;
}

bool WakeRule::path_explained_lately() const noexcept {
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (candidates_.all[i]->knows_path() && rendered_within(i, thresholds_.path_lately)) {
      return true;
    }
  }
  return false;
}

// At first there is nothing that could have moved; answers that have not converged lag behind as if
// the object had, and so does a force that depends on the path.
bool WakeRule::moved_is_no_cause() const noexcept {
  if (unfinished_for_ > 0) {
    return true;
  }
  return woken() ? path_explained_
                 : path_explained_lately() ||
                       queued_ < static_cast<std::uint64_t>(thresholds_.moved_samples);
}

bool WakeRule::awake(std::size_t index) const noexcept {
  if (index == candidates_.moved && enabled_ && index != rendered_ && moved_is_no_cause()) {
    return false;
  }
  if ((all_awake_ && !hopeless_[index]) || index == rendered_ || index == auditioned_ ||
      index == candidates_.newest) {
    return true;
  }
  if (index == candidates_.memory) {
    return false;
  }
  if (index == candidates_.places) {
    return contact_begins_;
  }
  return kept_lately(index) || (index == candidates_.unfinished && unfinished_for_ > 0) ||
         (index == candidates_.moved && queued_ < walls_until_) ||
         (index == candidates_.walls &&
          (queued_ < walls_until_ || candidates_.all[index]->field().knows_walls()));
}

}  // namespace forcegrid::kriging
