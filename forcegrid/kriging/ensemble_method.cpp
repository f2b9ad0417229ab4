// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/ensemble_method.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {

using kriging::Candidates;
using kriging::History;
using kriging::SampleQueue;

EnsembleMethod::EnsembleMethod(Kind kind, const MethodOptions& options,
                               const kriging::EnsembleThresholds& thresholds)
    : kind_(kind),
      thresholds_(thresholds),
      path_(kriging::kPathTimeConstants_s),
      candidates_(kriging::make_candidates(kind, options, thresholds_, path_)),
      choice_(candidates_, thresholds_),
      fade_(thresholds_.hand_over_s),
      wake_rule_(candidates_, thresholds_,
                 kind == Kind::kAuto && candidates_.all.size() > 1 && !thresholds_.everybody_awake),
      least_budget_reads_(kind == Kind::kAuto
                              ? std::optional(kriging::least_budget_reads(
                                    kriging::plan_for(options.budget_reads).samples))
                              : std::nullopt),
      budget_(kind == Kind::kAuto ? options.budget_reads : std::nullopt) {
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    names_[i] = candidates_.all[i]->name();
    knows_path_ = knows_path_ || candidates_.all[i]->knows_path();
    candidates_.all[i]->field().expect_reads(i == rendered_);
  }
}

const char* EnsembleMethod::name() const noexcept {
  return kind_ == Kind::kAuto ? "auto" : "kriging-bank";
}

MethodNeeds EnsembleMethod::needs() const noexcept {
  MethodNeeds needs;
  needs.requests_before_contact = asks_before_contact();
  needs.can_request = true;
  return needs;
}

std::size_t EnsembleMethod::memory_bytes() const noexcept {
  std::size_t bytes = sizeof(*this) + path_.allocated_bytes() +
                      candidates_.all.capacity() * sizeof(candidates_.all[0]);
  for (const auto& candidate : candidates_.all) {
    bytes += candidate->memory_bytes();
  }
  return bytes;
}

void EnsembleMethod::take_sample(const Sample& sample) noexcept {
  if (!queue_.accepts(sample, contact_, asks_before_contact())) {
    return;
  }
  if (!contact_.has_origin()) {
    enter_contact(sample.position_W);
  }
  idle_ = false;
  pass_over_backlog();
  const std::uint64_t number = queue_.taken();
  queue_.push(sample, contact_, motion_);
  answers_before_ += queue_.at(number).before_contact ? 1 : 0;
  EvaluatedSample& entry = evaluated(number);
  entry = EvaluatedSample{};
  entry.error_N2.fill(EvaluatedSample::kNotTaken_N2);
  wake_rule_.sample_queued(number, queue_.at(number), sample.time_s - contact_.begun_s(),
                           rendered_);
  follow_wake_rule();
  if (asks_before_contact() && wake_rule_.places_misses()) {
    candidates_.all[candidates_.places]->field().remember(queue_.at(number).observation);
  }
  if (sample.time_s > path_observed_s_) {
    observe_path();
  }
  look_up_path(sample, entry.path);
  if (sample.from_query) {
    entry.scored = false;
    return;
  }
  entry.first_touch =
      kind_ == Kind::kAuto && sample.time_s < contact_.begun_s() + thresholds_.first_touch_s;
  entry.scored = !entry.first_touch || sample.force_W.norm() > thresholds_.first_touch_N;
}

// Candidates that are not rendered may fall behind. The rendered one never falls behind by the
// queue's length, since it is served first.
void EnsembleMethod::pass_over_backlog() noexcept {
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const auto& candidate = candidates_.all[i];
    const bool catches_up = candidate->next_sample() < level_at_[i];
    const bool old_is_useless = i == rendered_ && budget_.limited() && !budget_.allows();
    const std::uint64_t longest = old_is_useless ? 1
                                  : catches_up   ? kLongestCatchUp
                                                 : SampleQueue::kLongestBacklog;
    if (candidate->awake() && queue_.taken() - candidate->next_sample() >= longest) {
      evaluated(candidate->next_sample()).scored = false;
      candidate->advance();
      ++counters_[old_is_useless ? kSamplesOverBudget : kPassedOver].value;
    }
  }
}

void EnsembleMethod::look_up_path(const Sample& sample,
                                  kriging::PathAtSample& path) const noexcept {
  path.lags_known = path_.find(sample.time_s, path.lags);
  if (path.lags_known && candidates_.relaxation != nullptr) {
    path.terms_known = candidates_.relaxation->find_terms(sample.time_s, path.lags, path.terms_N);
    path.terms_N.col(0) *= sample.from_query ? 0.0 : 1.0;  // answered to a tool at rest
  }
}

void EnsembleMethod::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (budget_.limited()) {
    budget_.begin_cycle(rendered_candidate().field().sample_count());
  }
  if (motion_.observe(time_s, position_W)) {
    if (path_awake_ || !(time_s < path_observed_s_ + kPathAsleep_s)) {
      observe_path();
    }
    follower_.tool_moved(motion_);
    if (candidates_.moved_role != nullptr && candidates_.moved_role->awake()) {
      candidates_.moved_role->set_time(time_s);
    }
  }
}

// While no candidate that knows them is awake, the paths of tool and force are followed by few
// points; filters of 50 ms and more, which the force passes through, by fewer.
void EnsembleMethod::observe_path() noexcept {
  if (!knows_path_ || !motion_.observed()) {
    return;
  }
  path_observed_s_ = motion_.time_s();
  path_.observe(path_observed_s_, motion_.position_W());
  if (candidates_.relaxation != nullptr &&
      (candidates_.relaxation->awake() ||
       !(path_observed_s_ < force_observed_s_ + kForceAsleep_s))) {
    observe_rendered_force();
  }
}

void EnsembleMethod::observe_rendered_force() noexcept {
  force_observed_s_ = motion_.time_s();
  Eigen::Vector3d rendered_N = Eigen::Vector3d::Zero();
  if (contact_.in_contact() && contact_.has_origin() &&
      rendered_candidate().field().sample_count() > 0) {
    rendered_N = force_N(rendered_candidate());
  }
  candidates_.relaxation->observe(motion_.time_s(), rendered_N, path_.now());
}

// A candidate's force at the tool's last observed position.
Eigen::Vector3d EnsembleMethod::force_N(const Candidate& candidate) const noexcept {
  const Eigen::Vector3d& tool_W = motion_.position_W();
  return candidate.field()
      .read(tool_W - contact_.origin_W(), candidate.history_at(tool_W, tool_W))
      .force_N;
}

void EnsembleMethod::contact_made(std::uint32_t /*epoch*/,
                                  const Eigen::Vector3d& point_W) noexcept {
  const bool changed = contact_.is_at(point_W);  // the object, by a cut, say
  contact_.made(motion_.time_s());
  if (point_W.allFinite()) {
    enter_contact(point_W);
  }
  idle_ = false;
  queue_.begin_contact();
  rendering_.begin_contact();
  requests_.begin_contact();
  fade_.clear();
  if (asks_before_contact() && !changed) {
    const kriging::CandidateChoice::Choice choice =
        choice_.for_contact(answers_before_, contact_.has_origin(), rendered_);
    if (choice.candidate != rendered_ || choice.reason != ChoiceReason::kFirstTouches) {
      hand_over(choice.candidate, choice.reason);
    }
  } else if (rendered_ == candidates_.places && choice_.runner_up(rendered_) != Candidates::kNone) {
    hand_over(choice_.runner_up(rendered_), ChoiceReason::kFirstTouches);
  }
  answers_before_ = 0;
  wake_rule_.contact_made();
  follow_wake_rule();
  place_undecided_ = asks_before_contact() && !changed && rendered_ != candidates_.places &&
                     candidates_.all[candidates_.places]->awake() &&
                     !candidates_.all[candidates_.places]->field().ready();
  update_uncertainty();
}

void EnsembleMethod::contact_lost() noexcept { contact_.lost(); }

void EnsembleMethod::expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
  if (asks_before_contact() && !contact_.in_contact() && std::isfinite(time_s) &&
      point_W.allFinite() && contact_.expect(time_s, point_W)) {
    enter_contact(point_W);
    requests_.begin_contact();
    answers_before_ = 0;
  }
}

void EnsembleMethod::enter_contact(const Eigen::Vector3d& point_W) noexcept {
  idle_ = false;
  contact_.set_origin(point_W);
  for (const auto& candidate : candidates_.all) {
    candidate->on_contact(contact_.number(), point_W);
  }
}

// The rendered candidate goes first, then what takes no time, then what has been begun. @returns
// Candidates::kNone if all are ready and have taken all samples.
std::size_t EnsembleMethod::next_to_serve() const noexcept {
  const auto is_unready = [](const Candidate& candidate) {
    return candidate.awake() && !candidate.field().ready();
  };
  const auto waits = [this](const Candidate& candidate) {
    return candidate.awake() && candidate.field().ready() &&
           candidate.next_sample() < queue_.taken();
  };
  if (is_unready(rendered_candidate()) || waits(rendered_candidate())) {
    return rendered_;
  }
  std::size_t unready = Candidates::kNone;
  std::size_t furthest = Candidates::kNone;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    const Candidate& candidate = *candidates_.all[i];
    if (waits(candidate) && candidate.served_early()) {
      return i;
    }
    if (unready == Candidates::kNone && is_unready(candidate)) {
      unready = i;
    }
    if (waits(candidate) && (furthest == Candidates::kNone ||
                             candidate.next_sample() < candidates_.all[furthest]->next_sample())) {
      furthest = i;
    }
  }
  return unready != Candidates::kNone ? unready : furthest;
}

// @returns the units of work done.
int EnsembleMethod::take_next(std::size_t index) noexcept {
  Candidate& candidate = *candidates_.all[index];
  const std::uint64_t number = candidate.next_sample();
  candidate.advance();
  const kriging::QueuedSample& sample = queue_.at(number);
  EvaluatedSample& entry = evaluated(number);
  kriging::Observation observation = sample.observation;
  switch (candidate.accept(sample, entry.path, observation)) {
    case Candidate::Accept::kTake:
      break;
    case Candidate::Accept::kNoUse:
      entry.error_N2[index] = EvaluatedSample::kNotTaken_N2;
      if (index == rendered_ && !sample.observation.from_query) {
        wake_rule_.rendered_had_no_use();
        follow_wake_rule();
      }
      return 1;
    case Candidate::Accept::kUnknown:
      entry.scored = false;
      return 1;
  }
  const bool elsewhere = index == rendered_ && index == candidates_.places && entry.first_touch &&
                         choice_.place_is_contradicted(observation);
  const kriging::Innovation innovation = candidate.field().take(observation);
  if (innovation.unfinished) {
    candidate.expect_result(number);
    // A search for walls begins in the same cycle.
    return index == candidates_.walls ? 1 : candidate.piece_units();
  }
  taken(index, number, innovation);
  if (elsewhere && index == rendered_ && choice_.runner_up(index) != Candidates::kNone) {
    hand_over(choice_.runner_up(index), ChoiceReason::kPredictedBetter);
  }
  return candidate.piece_units();
}

// A candidate has taken a sample.
void EnsembleMethod::taken(std::size_t index, std::uint64_t number,
                           const kriging::Innovation& innovation) noexcept {
  Candidate& candidate = *candidates_.all[index];
  EvaluatedSample& entry = evaluated(number);
  const bool from_query = queue_.at(number).observation.from_query;
  entry.scored = entry.scored && innovation.predicted;
  entry.likelihood_nats[index] = innovation.likelihood_nats;
  entry.error_N2[index] = innovation.error_N * innovation.error_N;
  if (index == rendered_) {
    entry.surprised = innovation.surprised || innovation.error_N > thresholds_.wall_plain_N;
    if (innovation.scale != 1.0 && candidates_.moved_role != nullptr &&
        !candidates_.moved_role->awake()) {
      candidates_.moved_role->scale_earlier_contacts(queue_.at(number).observation.contact,
                                                     candidate.field().contact_scale());
    }
    if (!from_query) {
      wake_rule_.rendered_took(innovation);
      follow_wake_rule();
    }
  }
  // A cut may begin with a force so small that it surprises nobody. But who woke just now and takes
  // old samples must not explain those that the rendered candidate was right about.
  const bool weaker = candidate.claim_reason() == ChoiceReason::kWeaker;
  const bool was_right = index != rendered_ && !entry.surprised &&
                         !(entry.error_N2[rendered_] > thresholds_.path_wrong_N2);
  if (candidate.on_taken(innovation, from_query) && !(weaker && was_right)) {
    entry.explained = true;
    const bool settled =
        number >= level_at_[index] + static_cast<std::uint64_t>(thresholds_.walls_settle);
    const bool is_wrong =
        entry.error_N2[rendered_] > thresholds_.wall_unusual * rendered_candidate().score_N2;
    const bool needed = weaker || ((entry.surprised || settled) && is_wrong);
    if (index == rendered_) {
      reason_ = candidate.claim_reason();
      claimed_at_ = number;
    } else if (needed && choice_.trusts(candidate, rendered_, entry.error_N2[rendered_])) {
      // Nobody was wrong so far: whose score is less by luck must not take over from it.
      candidate.score_N2 = std::min(candidate.score_N2, rendered_candidate().score_N2);
      hand_over(index, candidate.claim_reason());
      claimed_at_ = number;
    }
  }
  const bool follows = index == candidates_.memory && candidate.next_sample() == queue_.taken();
  if (index == rendered_) {
    take_rendered(candidate, number, follows);
  }
  if (follows) {
    follower_.sample_taken();
  }
}

// Called when the rendered candidate has taken a sample. @param follows: its field will change
// again.
void EnsembleMethod::take_rendered(const Candidate& candidate, std::uint64_t number,
                                   bool follows) noexcept {
  if (contact_.in_contact() && number >= queue_.first_of_contact()) {
    rendering_.contact_sampled();
  }
  if (candidate.next_sample() == queue_.taken() && !follows) {
    uncertainty_due_ = true;
  }
}

// Samples below this number have been predicted by all that are awake.
std::uint64_t EnsembleMethod::evaluated_by_all() const noexcept {
  std::uint64_t until = queue_.taken();
  for (const auto& candidate : candidates_.all) {
    until = candidate->awake() ? std::min(until, candidate->evaluated_until()) : until;
  }
  return until;
}

// Adds the errors of each sample to the scores once all candidates have taken it, so that they are
// always compared over the same samples.
void EnsembleMethod::score() noexcept {
  bool slept = false;
  std::uint64_t until = evaluated_by_all();
  while (scored_ < until) {
    const std::uint64_t number = scored_++;
    const EvaluatedSample& entry = evaluated(number);
    if (!entry.scored || entry.explained) {
      continue;
    }
    wake_rule_.evaluated(entry);
    choice_.score(entry, rendered_);
    follow_noise();
    const std::size_t best =
        kind_ == Kind::kAuto ? choice_.likely_best(rendered_) : choice_.best(rendered_);
    // Samples from before an event say nothing about who explains it, nor do single ones of those
    // that all are scored by once more.
    const bool before_claim =
        reason_ == candidates_.all[rendered_]->claim_reason() && number < claimed_at_;
    if (best != rendered_ && !before_claim && number + 1 >= scored_again_at_) {
      hand_over(best, ChoiceReason::kPredictedBetter);
      until = evaluated_by_all();  // whom that woke takes the last samples first
    }
    slept = wake_rule_.scored(choice_) || slept;
    if (wake_rule_.stays() != rendered_) {
      hand_over(wake_rule_.stays(), ChoiceReason::kAsGood);
    }
  }
  if (slept) {
    follow_wake_rule();
  }
}

// `moved` expects as much noise as those who know the position alone have learnt. Samples of an
// object that moves look as if they were noisy.
void EnsembleMethod::follow_noise() noexcept {
  if (candidates_.moved_role != nullptr && !candidates_.moved_role->differs()) {
    noise_as_ = choice_.likeliest_general(noise_as_);
    candidates_.moved_role->expect_noise(candidates_.all[noise_as_]->field().settings().nugget_N2);
  }
}

void EnsembleMethod::follow_wake_rule() noexcept {
  bool changed = false;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    Candidate& candidate = *candidates_.all[i];
    const bool awake = wake_rule_.awake(i);
    if (awake == candidate.awake()) {
      continue;
    }
    changed = true;
    if (awake) {
      wake(i);
    } else {
      candidate.sleep();
      begins_[i] = false;
    }
  }
  if (changed && knows_path_) {
    path_awake_ = std::any_of(
        candidates_.all.begin(), candidates_.all.end(),
        [](const auto& candidate) { return candidate->awake() && candidate->knows_path(); });
    observe_path();
  }
}

// It is scored by the last samples at once, and the others by them again. `walls` has to explain
// the newest one; `places` and `unfinished` are woken for the samples that come from now on.
void EnsembleMethod::wake(std::size_t index) noexcept {
  Candidate& candidate = *candidates_.all[index];
  const bool from_now_on =
      !wake_rule_.all_awake() && (index == candidates_.places || index == candidates_.unfinished);
  const std::uint64_t back = from_now_on || candidate.served_early() ? 1
                             : candidate.field().can_begin_with()    ? kScoredAtOnce
                                                                     : kTakesAtOnce;
  const std::uint64_t taken = queue_.taken();
  candidate.wake(std::max(taken - std::min(back, taken), std::min(candidate.next_sample(), taken)));
  level_at_[index] = taken;
  // What is known of its first touches stands where it is woken for one.
  const bool has_record = from_now_on && index == candidates_.places && candidate.first_touches > 0;
  const double known_N2 = has_record ? candidate.score_N2 : 0.0;
  const double first = wake_rule_.first_score(index);
  candidate.score_N2 = std::max(known_N2, first * rendered_candidate().score_N2);
  candidate.long_score_N2 = first * rendered_candidate().long_score_N2;
  candidate.likelihood_nats =
      candidates_.is_general(rendered_) ? rendered_candidate().likelihood_nats : 0.0;
  begins_[index] =
      !from_now_on && candidate.field().can_begin_with() && candidate.next_sample() > 0;
  // Once for each sample that came: hand-overs wake and put to sleep, and could go on for ever.
  const bool first_of_moved = index == candidates_.moved && !wake_rule_.woken();
  if (!from_now_on && !first_of_moved && scored_again_at_ != taken) {
    scored_again_at_ = taken;
    scored_ = std::min(scored_, taken - std::min(kScoredAtOnce, taken));
  }
}

// @returns the units of work done.
int EnsembleMethod::begin(std::size_t index) noexcept {
  begins_[index] = false;
  Candidate& candidate = *candidates_.all[index];
  const std::uint64_t end = candidate.next_sample();
  std::size_t count = 0;
  for (std::uint64_t n = end - std::min<std::uint64_t>(end, kBeginsWith); n < end; ++n) {
    recent_[count] = queue_.at(n).observation;
    const bool takes = candidate.accept(queue_.at(n), evaluated(n).path, recent_[count]) ==
                       Candidate::Accept::kTake;
    count += takes ? 1 : 0;
  }
  if (count > 0) {
    static_cast<void>(candidate.field().begin_with({recent_.data(), count}));
  }
  return candidate.piece_units();
}

// Whether it sleeps and has missed a sample. `memory` keeps all that it will be asked for; others
// leave those that they would be scored by if they were woken.
bool EnsembleMethod::has_missed(std::size_t index) const noexcept {
  const Candidate& candidate = *candidates_.all[index];
  const std::uint64_t left = index == candidates_.memory ? 0 : kScoredAtOnce;
  return candidate.remembers() && !candidate.awake() &&
         candidate.next_sample() + left < queue_.taken();
}

// @returns the units of work done; 0 if nobody has missed anything.
int EnsembleMethod::remember() noexcept {
  int done = 0;
  for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
    if (has_missed(i)) {
      Candidate& candidate = *candidates_.all[i];
      const kriging::QueuedSample& sample = queue_.at(candidate.next_sample());
      candidate.advance();
      const bool lags = i == candidates_.moved && sample.observation.unfinished;
      if (!sample.before_contact && !lags) {
        candidate.field().remember(sample.observation);
        candidate.on_remembered();
      }
      ++done;
    }
  }
  return done;
}

void EnsembleMethod::hand_over(std::size_t index, ChoiceReason reason) noexcept {
  kriging::Field& next = candidates_.all[index]->field();
  next.expect_reads(true);
  if (motion_.observed() && contact_.in_contact() && rendering_.is_contact_sampled()) {
    fade_.start(motion_.time_s(), force_N(rendered_candidate()), force_N(*candidates_.all[index]));
  }
  if (index != rendered_) {
    rendered_candidate().field().expect_reads(false);
  }
  rendered_ = index;
  reason_ = reason;
  wake_rule_.handed_over(index);
  follow_wake_rule();
  update_uncertainty();
}

// A field that is not ready does not take the next sample: the budget is used up.
int EnsembleMethod::prepare(std::size_t index, int budget) noexcept {
  Candidate& candidate = *candidates_.all[index];
  int done = 0;
  while (done < budget && !candidate.field().ready()) {
    candidate.field().prepare();
    done += candidate.piece_units();
    if (candidate.field().ready() && index == rendered_) {
      uncertainty_due_ = true;
    }
  }
  if (candidate.expects_result() && candidate.field().ready()) {
    taken(index, candidate.take_result(), candidate.field().taken());
  }
  if (place_undecided_ && index == candidates_.places && candidate.field().ready()) {
    decide_on_place();
  }
  return done;
}

// `places` has found out what it knows of a contact that has begun just now.
void EnsembleMethod::decide_on_place() noexcept {
  place_undecided_ = false;
  const bool begins =
      contact_.in_contact() && motion_.time_s() < contact_.begun_s() + thresholds_.places_learn_s;
  if (begins && contact_.has_origin() && rendered_ != candidates_.places &&
      choice_.place_is_known(rendered_)) {
    hand_over(candidates_.places, ChoiceReason::kKnownPlace);
  }
}

// Whether `memory` may have samples to exchange.
bool EnsembleMethod::may_follow() const noexcept {
  return candidates_.memory != Candidates::kNone && follower_.due() && contact_.in_contact() &&
         contact_.has_origin() && candidates_.all[candidates_.memory]->awake() &&
         candidates_.all[candidates_.memory]->next_sample() == queue_.taken();
}

// Does one piece of that exchange, for where the tool is going. What is rendered may be well known.
int EnsembleMethod::follow() noexcept {
  Candidate& memory = *candidates_.all[candidates_.memory];
  const double fine_N = rendered_ == candidates_.memory ? thresholds_.remembered_N : 0.0;
  follower_.step(memory.field(), tool_W(), contact_.origin_W(), motion_, fine_N);
  if (!follower_.due()) {
    if (rendered_ == candidates_.memory) {
      update_uncertainty();
    } else if (choice_.memory_takes_over(follower_.ahead_W() - contact_.origin_W(), rendered_)) {
      hand_over(candidates_.memory, ChoiceReason::kRemembers);
    }
  }
  return memory.piece_units();
}

// Whether the budget pays for the next sample of candidate `next` or, if that is none, for what is
// left to do without samples.
bool EnsembleMethod::is_paid_for(std::size_t next) const noexcept {
  return next == rendered_ ? budget_.allows() : budget_.allows_others();
}

// @returns the units of work done; 0 if there was nothing to do.
int EnsembleMethod::do_piece(std::size_t next, int budget) noexcept {
  if (next == Candidates::kNone) {
    const int remembered = remember();
    return remembered > 0 ? remembered : may_follow() ? follow() : 0;
  }
  int done = 0;
  if (begins_[next]) {
    done = begin(next);
  } else if (candidates_.all[next]->field().ready()) {
    done = take_next(next);
  }
  done += prepare(next, budget - done);
  score();
  return done;
}

// Whether all that are awake have done everything that can be done without another sample, contact
// or motion.
bool EnsembleMethod::all_ready() const noexcept {
  return std::all_of(candidates_.all.begin(), candidates_.all.end(), [](const auto& candidate) {
    return !candidate->awake() || candidate->field().ready();
  });
}

int EnsembleMethod::work(int budget) noexcept {
  if (idle_ && !may_follow()) {
    return 0;
  }
  int done = 0;
  uncertainty_waits_ += uncertainty_due_ ? 1 : 0;
  while (done < budget) {
    const std::size_t next = next_to_serve();
    if (uncertainty_due_ && (next == Candidates::kNone || uncertainty_waits_ > kUncertaintyWaits)) {
      update_uncertainty();  // a piece of its own, paid for with what has changed the field
      done += rendered_candidate().piece_units();
      continue;
    }
    if (!is_paid_for(next)) {
      counters_[kCyclesOverBudget].value += next != Candidates::kNone ? 1 : 0;
      break;
    }
    const int piece = do_piece(next, budget - done);
    if (piece == 0) {
      idle_ = all_ready();
      break;
    }
    budget_.spend(piece);
    done += piece;
  }
  return done;
}

double EnsembleMethod::deviation_N(const Candidate& candidate,
                                   const Eigen::Vector3d& position_W) const noexcept {
  return candidate.field().deviation_N(position_W - contact_.origin_W(),
                                       candidate.history_at(position_W, motion_.position_W()));
}

void EnsembleMethod::update_uncertainty() noexcept {
  const Candidate& candidate = rendered_candidate();
  uncertainty_due_ = false;
  uncertainty_waits_ = 0;
  if (contact_.has_origin() && candidate.field().sample_count() > 0) {
    rendering_.uncertainty().update(
        tool_W(), motion_, [&](const Eigen::Vector3d& p_W) { return deviation_N(candidate, p_W); });
    if (contact_.in_contact() &&
        wake_rule_.rendered_deviates(rendering_.uncertainty().largest_N())) {
      follow_wake_rule();
    }
  }
}

// Requests ask about places. Until it is decided who is rendered, that may be a candidate that
// knows the path, which is uncertain about more than these.
std::size_t EnsembleMethod::requests_planner() const noexcept {
  if (!wake_rule_.undecided()) {
    return rendered_;
  }
  const std::size_t general = wake_rule_.best_general();
  const bool knows = general != Candidates::kNone && candidates_.all[general]->awake() &&
                     candidates_.all[general]->field().ready() &&
                     candidates_.all[general]->field().sample_count() > 0;
  return knows ? general : rendered_;
}

bool EnsembleMethod::plan_request(double time_s, const Eigen::Vector3d& position_W,
                                  Eigen::Vector3d& wanted_W) noexcept {
  if (!contact_.has_origin() || !std::isfinite(time_s) || !position_W.allFinite()) {
    return false;
  }
  if (contact_.in_contact()) {
    const Candidate& planner = *candidates_.all[requests_planner()];
    return requests_.plan(
        time_s, position_W, contact_.origin_W(), motion_,
        [&](const Eigen::Vector3d& p_W) { return deviation_N(planner, p_W); }, wanted_W);
  }
  if (!asks_before_contact() || !contact_.expects(time_s)) {
    return false;
  }
  wake_rule_.asked_before_contact();
  follow_wake_rule();
  idle_ = false;
  const kriging::Field& places = candidates_.all[candidates_.places]->field();
  return places.ready() &&
         requests_.plan_before_contact(
             time_s, contact_.origin_W(),
             [&](const Eigen::Vector3d& d_m) { return places.deviation_N(d_m, History::Zero()); },
             wanted_W);
}

ForceEstimate EnsembleMethod::force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  estimate.candidate = static_cast<std::uint8_t>(rendered_);
  estimate.reason = reason_;
  const Candidate& candidate = rendered_candidate();
  if (rendering_.answers_without_field(time_s, position_W, contact_, estimate) ||
      candidate.field().sample_count() == 0) {
    return estimate;
  }
  rendering_.render(candidate.field(), candidate.history_at(position_W, motion_.position_W()),
                    position_W, contact_, fade_.at(time_s), candidate.least_uncertainty_N(),
                    estimate);
  return estimate;
}

}  // namespace forcegrid
