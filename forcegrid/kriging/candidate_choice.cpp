// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/candidate_choice.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::kriging {
namespace {

double averaged(double kept, double old, double now) noexcept {
  return kept * old + (1.0 - kept) * now;
}

}  // namespace

void CandidateChoice::score(const EvaluatedSample& sample, std::size_t rendered) noexcept {
  const auto& errors_N2 = sample.error_N2;
  const bool rendered_took = errors_N2[rendered] != EvaluatedSample::kNotTaken_N2;
  const double otherwise_N2 = errors_N2[rendered_took ? rendered : 0];
  if (otherwise_N2 == EvaluatedSample::kNotTaken_N2) {
    return;  // nobody is there to say how large an error is usual
  }
  ++long_scored_;
  const std::size_t count = candidates_.all.size();
  for (std::size_t i = 0; i < count; ++i) {
    Candidate& candidate = *candidates_.all[i];
    if (!candidate.awake()) {
      continue;
    }
    const double error_N2 =
        errors_N2[i] == EvaluatedSample::kNotTaken_N2 ? otherwise_N2 : errors_N2[i];
    candidate.scored_by_own = errors_N2[i] != EvaluatedSample::kNotTaken_N2;
    candidate.score_N2 = averaged(thresholds_.score_kept, candidate.score_N2, error_N2);
    candidate.long_score_N2 =
        averaged(thresholds_.long_score_kept, candidate.long_score_N2, error_N2);
    if (sample.first_touch && errors_N2[i] != EvaluatedSample::kNotTaken_N2) {
      candidate.first_touch_score_N2 =
          averaged(thresholds_.first_touch_kept, candidate.first_touch_score_N2, error_N2);
      ++candidate.first_touches;
    }
    candidate.on_evaluated({errors_N2.data(), count}, i);
  }
  score_known_place(sample);
  weigh(sample);
  first_touch_scored_ = first_touch_scored_ || sample.first_touch;
}

// A place that a deviation says is known may be that of an object which changed since.
void CandidateChoice::score_known_place(const EvaluatedSample& sample) noexcept {
  if (!place_known_ || !sample.first_touch) {
    return;
  }
  const double places_N2 = sample.error_N2[candidates_.places];
  const double exact_N2 = sample.error_N2[0];  // `auto` begins with it
  if (places_N2 != EvaluatedSample::kNotTaken_N2 && exact_N2 != EvaluatedSample::kNotTaken_N2) {
    known_place_N2_ = averaged(thresholds_.long_score_kept, known_place_N2_, places_N2);
    known_place_exact_N2_ = averaged(thresholds_.long_score_kept, known_place_exact_N2_, exact_N2);
  }
}

Peers CandidateChoice::peers() const noexcept {
  Peers peers;
  peers.long_scored = long_scored_;
  peers.general_long_score_N2 = std::numeric_limits<double>::max();
  peers.newest_long_score_N2 = candidates_.newest == Candidates::kNone
                                   ? std::numeric_limits<double>::max()
                                   : candidates_.all[candidates_.newest]->long_score_N2;
  for (const auto& candidate : candidates_.all) {
    if (candidate->awake() && !(candidate->weight() > 1.0)) {
      peers.general_long_score_N2 = std::min(peers.general_long_score_N2, candidate->long_score_N2);
    }
  }
  return peers;
}

std::size_t CandidateChoice::best(std::size_t rendered) const noexcept {
  if (is_good_enough(rendered)) {
    return rendered;
  }
  const Peers peers = this->peers();
  // Where a tool rests it is right, whoever knows the object; but it would not push back.
  const bool newest_may = candidates_.all[rendered]->score_N2 > thresholds_.path_wrong_N2;
  std::size_t best = rendered;
  double least_N2 = thresholds_.hysteresis * candidates_.all[rendered]->rate(peers);
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const double weight = is_lucky(i, rendered) ? thresholds_.lucky_weight : 1.0;
    const double rated_N2 = weight * candidates_.all[i]->rate(peers);
    // Whatever the weights. But what `walls` has proven counts more than its errors, unless the
    // object has moved since.
    const bool proofs_count = i == candidates_.walls && rendered != candidates_.moved;
    const bool erred_less = candidates_.all[i]->score_N2 < candidates_.all[rendered]->score_N2;
    const bool may_take_over = candidates_.all[i]->awake() && candidates_.all[i]->scored_by_own &&
                               (erred_less || proofs_count) &&
                               (i != candidates_.newest || newest_may);
    if (may_take_over && rated_N2 < least_N2) {
      best = i;
      least_N2 = rated_N2;
    }
  }
  return best;
}

// `newest` is not: where a tool rests it does not push back, however little it errs.
bool CandidateChoice::is_good_enough(std::size_t index) const noexcept {
  return index != candidates_.newest &&
         candidates_.all[index]->score_N2 < thresholds_.good_enough_N * thresholds_.good_enough_N;
}

// Where errors are as good as none, that which assumes the least noise will learn most from samples
// to come.
std::size_t CandidateChoice::with_less_noise(std::size_t rendered) const noexcept {
  if (!candidates_.is_general(rendered) || !is_good_enough(rendered)) {
    return rendered;
  }
  const double most_N2 =
      candidates_.all[rendered]->score_N2 + thresholds_.as_good_N * thresholds_.as_good_N;
  for (std::size_t i = 0; i < rendered; ++i) {
    const Candidate& candidate = *candidates_.all[i];
    if (candidates_.is_general(i) && candidate.awake() && candidate.scored_by_own &&
        candidate.score_N2 <= most_N2) {
      return i;
    }
  }
  return rendered;
}

// One sample that no noise explains must not decide for long.
void CandidateChoice::weigh(const EvaluatedSample& sample) noexcept {
  const auto is_weighed = [&](std::size_t i) {
    return candidates_.is_general(i) && candidates_.all[i]->awake() &&
           sample.error_N2[i] != EvaluatedSample::kNotTaken_N2;
  };
  double most_nats = std::numeric_limits<double>::lowest();
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    most_nats = is_weighed(i) ? std::max(most_nats, sample.likelihood_nats[i]) : most_nats;
  }
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (is_weighed(i)) {
      double& nats = candidates_.all[i]->likelihood_nats;
      nats = thresholds_.likelihood_kept * nats +
             std::max(sample.likelihood_nats[i] - most_nats, -thresholds_.most_unlikely_nats);
    }
  }
}

std::size_t CandidateChoice::likely_best(std::size_t rendered) const noexcept {
  const std::size_t better = this->best(rendered);
  const std::size_t best = better == rendered ? with_less_noise(rendered) : better;
  if (!candidates_.is_general(best)) {
    return best;
  }
  const Candidate& first = *candidates_.all[best];
  std::size_t likely = best;
  double least_nats = first.likelihood_nats + thresholds_.more_likely_nats;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const Candidate& candidate = *candidates_.all[i];
    if (candidates_.is_general(i) && candidate.awake() && candidate.scored_by_own &&
        candidate.score_N2 <= thresholds_.nearly_as_good * first.score_N2 &&
        candidate.likelihood_nats > least_nats) {
      likely = i;
      least_nats = candidate.likelihood_nats;
    }
  }
  return likely;
}

std::size_t CandidateChoice::likeliest_general(std::size_t than) const noexcept {
  std::size_t likeliest = than;
  double least_nats = candidates_.all[than]->awake()
                          ? candidates_.all[than]->likelihood_nats + thresholds_.more_likely_nats
                          : std::numeric_limits<double>::lowest();
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const Candidate& candidate = *candidates_.all[i];
    if (candidates_.is_general(i) && candidate.awake() && candidate.likelihood_nats > least_nats) {
      likeliest = i;
      least_nats = candidate.likelihood_nats;
    }
  }
  return likeliest;
}

// Whether it may be better than the rendered one by luck: over more samples it was worse, or that
// one has explained what no other can, and the difference is noise. `walls` and `newest` are right
// at once, or not at all.
bool CandidateChoice::is_lucky(std::size_t index, std::size_t rendered) const noexcept {
  const Candidate& candidate = *candidates_.all[index];
  const Candidate& other = *candidates_.all[rendered];
  const bool by_noise =
      other.claim_stands() && other.score_N2 - candidate.score_N2 < other.noise_N2();
  const bool right_at_once = index == candidates_.walls || index == candidates_.newest;
  return long_scored_ >= thresholds_.long_enough && index != rendered && !right_at_once &&
         (by_noise || candidate.long_score_N2 > other.long_score_N2);
}

std::size_t CandidateChoice::runner_up(std::size_t rendered) const noexcept {
  const Peers peers = this->peers();
  std::size_t best = Candidates::kNone;
  double least_N2 = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const double rated_N2 = candidates_.all[i]->rate(peers);
    if (i != rendered && candidates_.all[i]->awake() && candidates_.all[i]->differs() &&
        rated_N2 < least_N2) {
      best = i;
      least_N2 = rated_N2;
    }
  }
  return best;
}

CandidateChoice::Choice CandidateChoice::for_contact(int answers_before, bool origin_known,
                                                     std::size_t rendered) noexcept {
  place_known_ = false;
  // A candidate that slept at some first touches was averaged over fewer of them, from zero: as if
  // it had erred less.
  const auto weight_of = [this](const Candidate& candidate) {
    return 1.0 - std::pow(thresholds_.first_touch_kept, candidate.first_touches);
  };
  // `places` is asked though it sleeps: first touches are what it is for.
  const auto is_asked = [this](const auto& candidate) {
    return candidate->awake() || candidate == candidates_.all[candidates_.places];
  };
  double most_N2 = 0.0;
  double most_weight = 0.0;
  for (const auto& candidate : candidates_.all) {
    if (is_asked(candidate)) {
      most_N2 = std::max(most_N2, candidate->first_touch_score_N2);
      most_weight = std::max(most_weight, weight_of(*candidate));
    }
  }
  for (const auto& candidate : candidates_.all) {
    if (first_touch_scored_ && is_asked(candidate)) {
      const double weight = weight_of(*candidate);
      const double own_N2 = candidate->first_touch_score_N2;
      candidate->score_N2 = weight > 0.0 ? own_N2 * (most_weight / weight) : most_N2;
    }
  }
  remember_refuted_walls();
  if (answers_before >= thresholds_.enough_answers) {
    Candidate& places = *candidates_.all[candidates_.places];
    places.score_N2 = least_score_N2() / places.weight();
    return {candidates_.places, ChoiceReason::kAskedBefore};
  }
  if (origin_known && place_is_known(rendered)) {
    return {candidates_.places, ChoiceReason::kKnownPlace};
  }
  return {best(rendered), ChoiceReason::kFirstTouches};
}

// Surfaces stay in the workspace: if they were wrong lately, they are so in the next contact,
// however well first touches went before they were found.
void CandidateChoice::remember_refuted_walls() noexcept {
  if (candidates_.walls == Candidates::kNone) {
    return;
  }
  Candidate& walls = *candidates_.all[candidates_.walls];
  double others_N2 = std::numeric_limits<double>::max();
  for (const auto& candidate : candidates_.all) {
    others_N2 = candidate->awake() ? std::min(others_N2, candidate->long_score_N2) : others_N2;
  }
  if (walls.long_score_N2 > thresholds_.wall_refuted * others_N2 + thresholds_.wall_refuted_N2) {
    walls.score_N2 = std::max(walls.score_N2, walls.long_score_N2);
  }
}

// Of `places` and all that are awake.
double CandidateChoice::least_score_N2() const noexcept {
  double least_N2 = candidates_.all[candidates_.places]->score_N2;
  for (const auto& candidate : candidates_.all) {
    least_N2 = candidate->awake() ? std::min(least_N2, candidate->score_N2) : least_N2;
  }
  return least_N2;
}

bool CandidateChoice::place_is_known(std::size_t rendered) noexcept {
  if (rendered == candidates_.moved && candidates_.all[rendered]->differs()) {
    return false;  // it has changed since `places` learnt it
  }
  Candidate& places = *candidates_.all[candidates_.places];
  const double least_N2 = least_score_N2();
  const double deviation_N = places.field().deviation_N(thresholds_.probe_m, History::Zero());
  if (places.field().sample_count() == 0 || places.score_N2 > thresholds_.no_worse * least_N2 ||
      !(deviation_N < thresholds_.known_place_N)) {
    return false;
  }
  place_known_ = true;
  const bool errs_more = known_place_N2_ > thresholds_.no_worse * known_place_exact_N2_;
  const bool errs_little =
      std::max(known_place_N2_, deviation_N * deviation_N) < thresholds_.path_wrong_N2;
  if (errs_more && !errs_little) {
    return false;
  }
  places.score_N2 = least_N2 / places.weight();
  return true;
}

bool CandidateChoice::place_is_contradicted(const Observation& observation) noexcept {
  if (!observation.has_stiffness || observation.from_query) {
    return false;
  }
  Candidate& places = *candidates_.all[candidates_.places];
  const Eigen::Matrix3d error_N_per_m =
      places.field().stiffness_N_per_m(observation.position_m, History::Zero()) -
      stiffness_matrix(observation.stiffness_N_per_m);
  const double error_N = (error_N_per_m * thresholds_.probe_m).norm();
  if (!(error_N > thresholds_.known_place_N)) {
    return false;
  }
  places.score_N2 = std::max(places.score_N2, error_N * error_N);
  return true;
}

bool CandidateChoice::memory_takes_over(const Eigen::Vector3d& ahead_m,
                                        std::size_t rendered) noexcept {
  Candidate& memory = *candidates_.all[candidates_.memory];
  const Candidate& other = *candidates_.all[rendered];
  if (candidates_.memory_role->outdated() || other.knows_path() || other.claim_stands() ||
      other.field().knows_walls() ||
      memory.score_N2 > thresholds_.no_worse * thresholds_.no_worse * other.score_N2) {
    return false;
  }
  const double known_N = memory.field().deviation_N(ahead_m, History::Zero());
  if (!(other.field().deviation_N(ahead_m, History::Zero()) >
        std::max(thresholds_.remembers_more * known_N, thresholds_.remembers_more_N))) {
    return false;
  }
  memory.score_N2 = std::min(memory.score_N2, 0.5 * other.score_N2);
  return true;
}

}  // namespace forcegrid::kriging
