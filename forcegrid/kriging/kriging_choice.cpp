// KrigingMethod: which member of a bank speaks.

#include <algorithm>
#include <cmath>
#include <limits>

#include "forcegrid/kriging/kriging_method.h"

namespace forcegrid {
namespace {

constexpr double kScoreKept = 0.85;
constexpr double kHysteresis = 0.9;
// The member that finds walls. Squared errors of it against those of the best other: a proof, a
// disproof (unless it is some mN), and what its score counts for.
constexpr double kProof = 0.1;
constexpr double kDisproof = 4.0;
constexpr double kDisproof_N2 = 1e-3;
constexpr int kProofs = 2;
constexpr double kProvenWalls = 0.05;
constexpr double kCalmWalls = 0.2;
constexpr double kCalm = 0.17;    // of its samples are surprises: the first in half a second
constexpr double kTrusted = 0.1;  // its score, before a surprise that it alone explains

// Of members that know the path, against those that know the position alone.
constexpr double kLongScoreKept = 0.92;
constexpr std::uint64_t kLongEnough = 20;
constexpr double kWrong_N2 = 1e-4;  // 10 mN: less is not worth the risk
constexpr double kBetterForLong = 0.8;

constexpr double kYoungScoreKept = 0.97;
constexpr int kEnoughAnswers = 4;
const Eigen::Vector3d kProbe_m(0.0, 0.0, 0.004);
constexpr double kKnownPlace_N = 0.15;
constexpr double kNoWorse = 2.0;

// What was learnt long ago: doubtful for so long after a surprise; worth it where the deviation of
// what is felt is larger by so much.
constexpr double kOutdated = 0.01;  // of the last samples were surprises
constexpr double kRemembersMore = 3.0;
constexpr double kRemembersMore_N = 0.01;

}  // namespace

// Before anything of a contact is known.
void KrigingMethod::choose_for_contact() noexcept {
  if (places_ == kNobody || members_.size() == 1) {
    return;
  }
  double least_N2 = std::numeric_limits<double>::max();
  for (Member& member : members_) {
    if (young_scored_) {
      member.score_N2 = member.young_score_N2;
    }
    least_N2 = std::min(least_N2, member.score_N2);
  }
  Member& places = members_[places_];
  if (answers_before_ >= kEnoughAnswers) {
    places.score_N2 = least_N2 / places.handicap;
    hand_over(places_, ChoiceReason::kAskedBefore);
  } else if (origin_known_ && places.field->sample_count() > 0 &&
             places.score_N2 <= kNoWorse * least_N2 &&
             places.field->deviation_N(kProbe_m, kriging::History::Zero()) < kKnownPlace_N) {
    places.score_N2 = least_N2 / places.handicap;
    hand_over(places_, ChoiceReason::kKnownPlace);
  } else {
    const std::size_t best = best_member();
    if (best != active_) {
      hand_over(best, ChoiceReason::kFirstTouches);
    }
  }
}

// What taking in a sample has shown of a member, beyond its error.
void KrigingMethod::note(Member& member, Queued& entry,
                         const kriging::Innovation& innovation) noexcept {
  if (!entry.observation.from_query) {
    member.surprises =
        kScoreKept * member.surprises + (innovation.surprised ? 1.0 - kScoreKept : 0.0);
  }
  const auto index = static_cast<std::size_t>(&member - members_.data());
  if (member.finds_walls && innovation.explained && member.surprises < kCalm) {
    entry.wall_found = true;
    if (index != active_ && kTrusted * member.score_N2 < members_[active_].score_N2) {
      hand_over(index, ChoiceReason::kFoundWall);
    }
  }
}

// What a member's score counts for. One that has found walls is right where no other is: others
// have to be better by far, and by more once it has been proven.
double KrigingMethod::rating(const Member& member) const noexcept {
  if (member.field->knows_walls() && member.proofs >= kProofs) {
    return kProvenWalls * member.score_N2;
  }
  if (member.field->knows_walls() && member.surprises < kCalm) {
    return kCalmWalls * member.score_N2;
  }
  if (proven_by_path(member)) {
    return member.score_N2;
  }
  const bool outdated = member.keeps_all && member.surprises > kOutdated;
  return (outdated ? kSpecialist : member.handicap) * member.score_N2;
}

// A force that depends on more than the position, seen for so long that it is no lucky run.
bool KrigingMethod::proven_by_path(const Member& member) const noexcept {
  if (!(member.uses_history || member.uses_terms) || long_scored_ < kLongEnough) {
    return false;
  }
  double others_N2 = std::numeric_limits<double>::max();
  for (const Member& each : members_) {
    others_N2 = each.handicap > 1.0 ? others_N2 : std::min(others_N2, each.long_score_N2);
  }
  return others_N2 > kWrong_N2 && member.long_score_N2 < kBetterForLong * others_N2;
}

// The felt one unless another is clearly better.
std::size_t KrigingMethod::best_member() const noexcept {
  std::size_t best = active_;
  double least = kHysteresis * rating(members_[active_]);
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const double rated = rating(members_[i]);
    if (rated < least) {
      best = i;
      least = rated;
    }
  }
  return best;
}

// A wall is proven by samples that no member without it comes near to.
void KrigingMethod::prove(Member& member, const Queued& entry) noexcept {
  double others_N2 = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < members_.size(); ++i) {
    if (&members_[i] != &member) {
      others_N2 = std::min(others_N2, entry.error_N2[i]);
    }
  }
  const double own_N2 = entry.error_N2[static_cast<std::size_t>(&member - members_.data())];
  if (!member.field->knows_walls() || own_N2 > kDisproof * others_N2 + kDisproof_N2) {
    member.proofs = 0;
  } else if (own_N2 < kProof * others_N2) {
    ++member.proofs;
  }
}

// Takes the errors of each sample into the scores once all members have seen it, so that they are
// always compared over the same samples.
void KrigingMethod::score() noexcept {
  std::uint64_t seen = taken_;
  for (const Member& member : members_) {
    seen = std::min(seen, member.next);
  }
  for (; scored_ < seen; ++scored_) {
    const Queued& entry = queued(scored_);
    if (!entry.scored || entry.wall_found) {
      continue;  // none could know that a wall was there
    }
    ++long_scored_;
    // One that had no use for the sample is taken to do as the felt one does.
    const bool felt_took = entry.error_N2[active_] != kNotTaken_N2;
    const double otherwise_N2 = entry.error_N2[felt_took ? active_ : 0];
    for (std::size_t i = 0; i < members_.size(); ++i) {
      Member& member = members_[i];
      const double error_N2 = entry.error_N2[i] == kNotTaken_N2 ? otherwise_N2 : entry.error_N2[i];
      member.score_N2 = kScoreKept * member.score_N2 + (1.0 - kScoreKept) * error_N2;
      member.long_score_N2 =
          kLongScoreKept * member.long_score_N2 + (1.0 - kLongScoreKept) * error_N2;
      if (entry.young) {
        member.young_score_N2 =
            kYoungScoreKept * member.young_score_N2 + (1.0 - kYoungScoreKept) * error_N2;
      }
      if (member.finds_walls) {
        prove(member, entry);
      }
    }
    if (entry.young) {
      young_scored_ = true;
    }
    const std::size_t best = best_member();
    if (best != active_) {
      hand_over(best, ChoiceReason::kPredictedBetter);
    }
  }
}

void KrigingMethod::hand_over(std::size_t member, ChoiceReason reason) noexcept {
  if (observed_ && in_contact_ && contact_sampled_) {
    const Eigen::Vector3d p = position_W_ - origin_W_;
    const double left = std::exp(-(time_s_ - handed_over_s_) / kHandOver_s);
    handed_over_N_ =
        left * handed_over_N_ +
        members_[active_].field->read(p, history_at(members_[active_], position_W_)).force_N -
        members_[member].field->read(p, history_at(members_[member], position_W_)).force_N;
    handed_over_s_ = time_s_;
  }
  active_ = member;
  reason_ = reason;
  update_uncertainty();
}

// A tool that goes where the felt field knows little, but the store much: that is felt from now on,
// as long as it foretells what comes.
void KrigingMethod::remember_place() noexcept {
  Member& memory = members_[follower_];
  const Member& felt = members_[active_];
  if (!memory.keeps_all || memory.surprises > kOutdated || felt.uses_history || felt.uses_terms ||
      felt.field->knows_walls() || memory.score_N2 > kNoWorse * kNoWorse * felt.score_N2) {
    return;
  }
  const Eigen::Vector3d ahead_m = followed_to_W_ - origin_W_;
  const double known_N = memory.field->deviation_N(ahead_m, kriging::History::Zero());
  if (felt.field->deviation_N(ahead_m, kriging::History::Zero()) >
      std::max(kRemembersMore * known_N, kRemembersMore_N)) {
    memory.score_N2 = std::min(memory.score_N2, 0.5 * felt.score_N2);
    hand_over(follower_, ChoiceReason::kRemembers);
  }
}

}  // namespace forcegrid
