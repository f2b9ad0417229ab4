#include "forcegrid/kriging/kriging_method.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid {
namespace {

// The first instants of a contact, and the force that tells something about them: at the very
// first there is none, whatever the object.
constexpr double kYoung_s = 0.3;
constexpr double kFelt_N = 0.1;

constexpr double kUnfinished = 0.01;  // relative residual
constexpr double kNextPeriods = 1.6;  // a sample later than this has lost the one before it

// Beyond this distance from every sample the force is unknown.
constexpr double kUnknown_m = 0.090;

// An expected contact is another one for places that differ by more than this.
constexpr double kExpectedApart_m = 0.002;

constexpr double kLeastAhead_m = 1e-3;  // for the slope of the uncertainty

// A store brings in what it has around where the tool will be then, and again further on.
constexpr double kFollowAhead_s = 0.050;
constexpr double kFollowFurther_m = 0.003;

constexpr double kScaleChanged = 1e-3;  // what was told from earlier contacts is out of date

constexpr double kVelocityFilter_s = 0.010;
constexpr double kLongestStep_s = 0.1;

}  // namespace

const char* KrigingMethod::name() const noexcept {
  switch (kind_) {
    case Kind::kForceOnly:
      return "kriging";
    case Kind::kTangent:
      return "kriging-tangent";
    case Kind::kHinge:
      return "kriging-hinge";
    case Kind::kStore:
      return "kriging-store";
    case Kind::kBank:
      return "kriging-bank";
    case Kind::kContact:
      return "kriging-contact";
    case Kind::kAuto:
      return "auto";
  }
  return "invalid kind";
}

MethodNeeds KrigingMethod::needs() const noexcept {
  MethodNeeds needs;
  needs.stiffness = kind_ == Kind::kTangent;
  needs.requests_before_contact = places_ != kNobody;
  return needs;
}

std::size_t KrigingMethod::memory_bytes() const noexcept {
  std::size_t bytes =
      sizeof(*this) + history_.allocated_bytes() +
      (force_history_ != nullptr ? sizeof(*force_history_) + force_history_->allocated_bytes()
                                 : 0) +
      members_.capacity() * sizeof(Member);
  for (const Member& member : members_) {
    bytes += member.field->memory_bytes();
  }
  return bytes + (store_ != nullptr ? store_->memory_bytes() : 0);
}

void KrigingMethod::take_sample(const Sample& sample) noexcept {
  // Only a field that tells places apart can use what was asked for before contact.
  const bool of_expected = sample.before_contact && sample.from_query && places_ != kNobody &&
                           origin_known_ && sample.contact_point_W.allFinite();
  if (!(of_expected || (in_contact_ && !sample.before_contact)) || !std::isfinite(sample.time_s) ||
      !sample.position_W.allFinite() || !sample.force_W.allFinite() ||
      (!sample.from_query && sample.time_s < newest_sample_s_)) {
    return;
  }
  if (!origin_known_) {
    set_origin(sample.position_W);
  }
  // Members that are not felt may be late; the felt one never is by as much as the queue's length,
  // for it is served first.
  for (Member& member : members_) {
    if (taken_ - member.next >= kLongestBacklog) {
      queued(member.next).scored = false;
      ++member.next;
      ++passed_over_.value;
    }
  }
  Queued& entry = queued(taken_++);
  entry = Queued{};
  kriging::Observation& o = entry.observation;
  o.origin_W = of_expected ? sample.contact_point_W : origin_W_;
  o.position_m = sample.position_W - o.origin_W;
  o.force_N = sample.force_W;
  o.from_query = sample.from_query;
  o.contact = contact_;
  entry.before_contact = of_expected;
  entry.unfinished = !sample.converged || sample.relative_residual > kUnfinished;
  answers_before_ += of_expected ? 1 : 0;
  o.has_stiffness = sample.has_stiffness && sample.stiffness_W.allFinite();
  if (o.has_stiffness) {
    for (int i = 0; i < 6; ++i) {
      const int r = kriging::kStiffnessRow[i];
      const int c = kriging::kStiffnessColumn[i];
      o.stiffness_N_per_m[i] = 0.5 * (sample.stiffness_W(r, c) + sample.stiffness_W(c, r));
    }
  }
  ToolHistory::Lags force_lags_N;
  entry.lags_known = history_.find(sample.time_s, entry.lags);
  if (force_history_ != nullptr && entry.lags_known) {
    entry.terms_known = force_history_->find(sample.time_s, force_lags_N);
    if (entry.terms_known) {
      o.terms_N = path_terms_N(entry.lags, force_lags_N);
      o.terms_N.col(0) *= sample.from_query ? 0.0 : 1.0;  // answered to a tool at rest
    }
  }
  if (sample.from_query) {
    entry.scored = false;
    entry.lags_known = false;
    return;
  }
  o.has_rise = risen_from_ && sample.time_s - newest_sample_s_ < kNextPeriods * sample_period_s_;
  o.rise_N = sample.force_W - newest_force_N_;
  risen_from_ = true;
  newest_force_N_ = sample.force_W;
  entry.young = kind_ == Kind::kAuto && sample.time_s < contact_s_ + kYoung_s;
  entry.scored = !entry.young || sample.force_W.norm() > kFelt_N;
  newest_sample_s_ = sample.time_s;
  newest_sample_W_ = sample.position_W;
  if (observed_) {
    const double interval_s = std::clamp(time_s_ - last_arrival_s_, 1e-3, 0.2);
    sample_period_s_ += 0.2 * (interval_s - sample_period_s_);
    last_arrival_s_ = time_s_;
  }
}

void KrigingMethod::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    return;
  }
  const double dt_s = time_s - time_s_;
  if (observed_ && dt_s > 0.0 && dt_s < kLongestStep_s) {
    const Eigen::Vector3d velocity_W = (position_W - position_W_) / dt_s;
    velocity_W_ += dt_s / (dt_s + kVelocityFilter_s) * (velocity_W - velocity_W_);
  } else if (!observed_ || dt_s != 0.0) {
    velocity_W_.setZero();
  }
  observed_ = true;
  time_s_ = time_s;
  position_W_ = position_W;
  history_.observe(time_s, position_W);
  remember_force();
  if ((position_W_ + kFollowAhead_s * velocity_W_ - followed_to_W_).norm() > kFollowFurther_m) {
    pieces_to_follow_ = kMostPieces;
  }
}

void KrigingMethod::remember_force() noexcept {
  if (force_history_ == nullptr) {
    return;
  }
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
  const Member& member = members_[active_];
  if (in_contact_ && origin_known_ && member.field->sample_count() > 0) {
    force_N = member.field->read(position_W_ - origin_W_, history_at(member, position_W_)).force_N;
  }
  force_history_->observe(time_s_, force_N);
  members_[remembering_].field->observe(path_terms_N(history_.now(), force_history_->now()));
}

void KrigingMethod::contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& point_W) noexcept {
  ++contact_;
  in_contact_ = true;
  contact_state_known_ = true;
  expected_s_ = -1e300;
  origin_known_ = false;
  if (point_W.allFinite()) {
    set_origin(point_W);
  }
  first_of_contact_ = taken_;
  contact_s_ = time_s_;
  contact_sampled_ = false;
  risen_from_ = false;
  handed_over_N_.setZero();
  asked_.fill(Asked{});
  choose_for_contact();
  answers_before_ = 0;
  update_uncertainty();
}

void KrigingMethod::contact_lost() noexcept {
  in_contact_ = false;
  contact_state_known_ = true;
  expected_s_ = -1e300;
}

void KrigingMethod::set_origin(const Eigen::Vector3d& point_W) noexcept {
  origin_W_ = point_W;
  origin_known_ = true;
  for (Member& member : members_) {
    member.field->enter_contact(contact_, point_W);
  }
}

void KrigingMethod::expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
  if (places_ == kNobody || in_contact_ || !std::isfinite(time_s) || !point_W.allFinite()) {
    return;
  }
  const bool another =
      !(time_s - expected_s_ < kExpected_s) || (point_W - origin_W_).norm() > kExpectedApart_m;
  expected_s_ = time_s;
  if (another) {
    ++contact_;
    set_origin(point_W);
    asked_.fill(Asked{});
    answers_before_ = 0;
  }
}

// Of the lags of the tool and of the force. What the lag behind a filter that never forgets is more
// than the lag behind another is what that one lets through, but for a constant.
kriging::PathTerms KrigingMethod::path_terms_N(const ToolHistory::Lags& tool_m,
                                               const ToolHistory::Lags& force_N) noexcept {
  constexpr double kPerLag = kriging::kViscousTerm_Ns_per_m / kTimeConstants_s[kVelocityLag];
  kriging::PathTerms terms_N;
  terms_N.col(0) = kPerLag * tool_m.col(kVelocityLag).cast<double>();
  for (int j = 1; j < kriging::kPathTerms; ++j) {
    terms_N.col(j) = (force_N.rightCols<1>() - force_N.col(j - 1)).cast<double>();
  }
  return terms_N;
}

kriging::History KrigingMethod::history_at(const Member& member,
                                           const Eigen::Vector3d& position_W) const noexcept {
  kriging::History h = kriging::History::Zero();
  if (member.uses_history && !history_.empty()) {
    h = history_.now().middleCols<kriging::kHistoryFeatures>(member.first_lag).cast<double>();
    h.colwise() += position_W - position_W_;
  }
  return h;
}

// The felt member first, then the one that finds walls, then the one furthest behind.
KrigingMethod::Member* KrigingMethod::next_to_work() noexcept {
  if (members_[active_].next < taken_) {
    return &members_[active_];
  }
  for (Member& member : members_) {
    if (member.finds_walls && member.next < taken_) {
      return &member;
    }
  }
  Member* furthest = nullptr;
  for (Member& member : members_) {
    if (member.next < taken_ && (furthest == nullptr || member.next < furthest->next)) {
      furthest = &member;
    }
  }
  return furthest;
}

// Whether a sample is of any use to a member.
bool KrigingMethod::takes(const Member& member, const Queued& entry) noexcept {
  if (entry.before_contact) {
    return member.knows_places;  // only a field that tells places apart
  }
  return entry.unfinished || !member.only_unfinished;
}

int KrigingMethod::take_one(Member& member) noexcept {
  const std::uint64_t number = member.next++;
  Queued& entry = queued(number);
  const auto index = static_cast<std::size_t>(&member - members_.data());
  if (!takes(member, entry)) {
    entry.error_N2[index] = kNotTaken_N2;
    return 1;
  }
  kriging::Observation observation = entry.observation;
  if (member.uses_terms) {
    if (!entry.terms_known) {
      entry.scored = false;
      return 1;
    }
  }
  if (member.uses_history) {
    if (entry.lags_known) {
      observation.history =
          entry.lags.middleCols<kriging::kHistoryFeatures>(member.first_lag).cast<double>();
    } else if (!observation.from_query) {
      entry.scored = false;  // its path was not observed
      return 1;
    }
  }
  const kriging::Innovation innovation = member.field->take(observation);
  entry.scored = entry.scored && innovation.predicted;
  entry.error_N2[index] = innovation.error_N * innovation.error_N;
  note(member, entry, innovation);
  if (&member == &members_[active_]) {
    ++fits_;
    if (innovation.surprised || std::abs(innovation.scale - 1.0) > kScaleChanged) {
      surprised_fit_ = fits_;
    }
    contact_sampled_ = contact_sampled_ || (in_contact_ && number >= first_of_contact_);
    if (member.next == taken_ && index != follower_) {  // else after what follows was brought in
      update_uncertainty();
    }
  }
  if (index == follower_ && member.next == taken_) {
    pieces_to_follow_ = kMostPieces;
  }
  const int rows = member.field->row_count();
  return 1 + rows * rows / 2;
}

// Whether there may be something to bring in from the store.
bool KrigingMethod::may_follow() const noexcept {
  return follower_ != kNobody && pieces_to_follow_ > 0 && in_contact_ && origin_known_ &&
         members_[follower_].next == taken_;
}

// One piece of that, where the tool is going.
int KrigingMethod::follow() noexcept {
  const Eigen::Vector3d tool_W = observed_ ? position_W_ : newest_sample_W_;
  followed_to_W_ = tool_W + kFollowAhead_s * velocity_W_;
  kriging::Field& field = *members_[follower_].field;
  const kriging::Followed followed = field.follow(tool_W - origin_W_, followed_to_W_ - origin_W_);
  const bool felt = active_ == follower_;
  fits_ += followed.changed && felt ? 1 : 0;
  pieces_to_follow_ = followed.more ? pieces_to_follow_ - 1 : 0;
  if (pieces_to_follow_ == 0) {
    if (felt) {
      update_uncertainty();
    } else {
      remember_place();
    }
  }
  return 1 + field.row_count() * field.row_count() / 2;
}

// A field that is not ready does not take the next sample: the budget is used up.
int KrigingMethod::prepare(Member& member, int budget) noexcept {
  int done = 0;
  while (done < budget && !member.field->ready()) {
    member.field->prepare();
    const int rows = member.field->row_count();
    done += 1 + rows * rows / 2;
    if (member.field->ready() && &member == &members_[active_]) {
      update_uncertainty();
    }
  }
  return done;
}

int KrigingMethod::work(int budget) noexcept {
  int done = 0;
  for (Member& member : members_) {
    done += prepare(member, budget - done);
  }
  while (done < budget) {
    Member* member = next_to_work();
    if (member == nullptr) {
      if (!may_follow()) {
        break;
      }
      done += follow();
      continue;
    }
    done += take_one(*member);
    done += prepare(*member, budget - done);
    if (members_.size() > 1) {
      score();
    }
  }
  return done;
}

void KrigingMethod::update_uncertainty() noexcept {
  const Member& member = members_[active_];
  if (!origin_known_ || member.field->sample_count() == 0) {
    return;
  }
  uncertain_from_W_ = observed_ ? position_W_ : newest_sample_W_;
  const double speed = velocity_W_.norm();
  const double moves_m = speed * sample_period_s_;
  const double ahead_m = std::max(moves_m, kLeastAhead_m);
  const Eigen::Vector3d direction =
      speed > 0.0 ? Eigen::Vector3d(velocity_W_ / speed) : Eigen::Vector3d::UnitX();
  const Eigen::Vector3d ahead_W = uncertain_from_W_ + ahead_m * direction;
  uncertainty_from_N_ = member.field->deviation_N(uncertain_from_W_ - origin_W_,
                                                  history_at(member, uncertain_from_W_));
  uncertainty_slope_N_per_m_ =
      (member.field->deviation_N(ahead_W - origin_W_, history_at(member, ahead_W)) -
       uncertainty_from_N_) /
      ahead_m;
  // A tool at rest may start in any direction.
  uncertain_direction_ =
      moves_m < kLeastAhead_m ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : direction;
}

double KrigingMethod::uncertainty_N(const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Vector3d d = position_W - uncertain_from_W_;
  const double along_m = d.dot(uncertain_direction_);
  const double beside_m = std::sqrt(std::max(0.0, d.squaredNorm() - along_m * along_m));
  return std::max(members_[active_].least_uncertainty_N,
                  uncertainty_from_N_ + uncertainty_slope_N_per_m_ * along_m +
                      std::abs(uncertainty_slope_N_per_m_) * beside_m);
}

void KrigingMethod::say_how_sure(const Eigen::Vector3d& position_W,
                                 ForceEstimate& estimate) const noexcept {
  estimate.uncertainty_N = uncertainty_N(position_W);
  estimate.status = contact_sampled_ && estimate.uncertainty_N <= kKnown_N
                        ? EstimateStatus::kOk
                        : EstimateStatus::kPartlyKnown;
}

ForceEstimate KrigingMethod::force(double time_s,
                                   const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  estimate.member = static_cast<std::uint8_t>(active_);
  estimate.reason = reason_;
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  if (!in_contact_) {
    if (contact_state_known_) {
      estimate.status = EstimateStatus::kOk;  // free space: the force is known to be zero
      estimate.uncertainty_N = 0.0;
    }
    return estimate;
  }
  const Member& member = members_[active_];
  if (!origin_known_ || member.field->sample_count() == 0) {
    return estimate;
  }
  const Eigen::Vector3d p = position_W - origin_W_;
  const kriging::History history = history_at(member, position_W);
  const kriging::Reading reading = member.field->read(p, history);
  if (!(reading.nearest_m2 < kUnknown_m * kUnknown_m) || !reading.force_N.allFinite()) {
    estimate.uncertainty_N =
        std::sqrt(member.field->settings().kernel.prior_variance_N2(p, history));
    return estimate;
  }
  estimate.force_W = reading.force_N;
  const double age_s = time_s - handed_over_s_;
  if (age_s < 5.0 * kHandOver_s) {
    estimate.force_W += handed_over_N_ * std::exp(-std::max(age_s, 0.0) / kHandOver_s);
  }
  say_how_sure(position_W, estimate);
  if (reading.nearest_m2 > kFade_m * kFade_m) {
    const double left = (kUnknown_m - std::sqrt(reading.nearest_m2)) / (kUnknown_m - kFade_m);
    const double fade = left * left * (3.0 - 2.0 * left);
    estimate.force_W *= fade;
    estimate.uncertainty_N +=
        (1.0 - fade) * std::sqrt(member.field->settings().kernel.prior_variance_N2(p, history));
    estimate.status = EstimateStatus::kPartlyKnown;
  }
  return estimate;
}

}  // namespace forcegrid
