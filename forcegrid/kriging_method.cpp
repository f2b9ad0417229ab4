#include "forcegrid/kriging_method.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "forcegrid/contact_field.h"
#include "forcegrid/kriging_hinge.h"
#include "forcegrid/kriging_store_field.h"

namespace forcegrid {
namespace {

using kriging::ContactField;
using kriging::DictionaryField;
using kriging::FieldSettings;
using kriging::RadialShape;

constexpr int kSamples = 32;
constexpr int kHistorySamples = 48;
constexpr int kStiffnessSamples = 4;
constexpr int kBankStiffnessSamples = 2;
constexpr double kNugget_N2 = 1e-5;

// Lags 0 to 2 belong to the bank's first member with history, 3 to 5 to the others.
constexpr ToolHistory::TimeConstants kTimeConstants_s = {0.010, 0.100, 1.000, 0.005, 0.030, 0.200};

constexpr double kScoreKept = 0.85;
constexpr double kHysteresis = 0.9;
constexpr double kSpecialist = 3.0;
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
constexpr double kHandOver_s = 0.010;

// Beyond this distance from every sample the force is unknown.
constexpr double kUnknown_m = 0.090;

// Requests: not twice within this time and distance, the nearer the better.
constexpr double kAskAgain_s = 0.3;
constexpr double kAskApart_m = 0.003;
constexpr double kAskReach_m = 0.012;
constexpr double kAskFurthest_m = 0.015;
constexpr double kAskBeside_m = 0.006;

// Before contact: the expectation holds for this long unless it is told again, and for places that
// differ by no more than this. Displacements to ask for, the surface's normal being z.
constexpr double kExpected_s = 0.1;
constexpr double kExpectedApart_m = 0.002;
constexpr double kAskBefore_m[][3] = {
    {0.0, 0.0, 0.004},      {0.0, 0.0, 0.012},      {0.005, 0.0, 0.006},     {-0.005, 0.0, 0.006},
    {0.0, 0.005, 0.006},    {0.0, -0.005, 0.006},   {0.0, 0.0, 0.018},       {0.005, 0.005, 0.012},
    {-0.005, 0.005, 0.012}, {0.005, -0.005, 0.012}, {-0.005, -0.005, 0.012}, {0.0, 0.0, 0.008},
    {0.0, 0.0, -0.004}};

constexpr double kLeastAhead_m = 1e-3;  // for the slope of the uncertainty

// A store brings in what it has around where the tool will be then, and again further on.
constexpr double kFollowAhead_s = 0.050;
constexpr double kFollowFurther_m = 0.003;

constexpr double kScaleChanged = 1e-3;  // what was told from earlier contacts is out of date

constexpr double kVelocityFilter_s = 0.010;
constexpr double kLongestStep_s = 0.1;

}  // namespace

KrigingMethod::KrigingMethod(Kind kind, const MethodOptions& options)
    : kind_(kind), history_(kTimeConstants_s) {
  members_.reserve(kMaxMembers);
  FieldSettings settings;
  settings.nugget_N2 = options.nugget.value_or(kNugget_N2);
  settings.samples = options.samples.value_or(kSamples);
  settings.spacing.metres = options.spacing_m.value_or(settings.spacing.metres);
  settings.spacing.newtons = options.spacing_N.value_or(settings.spacing.newtons);
  if (kind == Kind::kHinge) {
    add_hinge_member(name(), settings);
    return;
  }
  if (kind == Kind::kStore) {
    add_store_member(name(), settings);
    return;
  }
  settings.stiffness_samples = kind == Kind::kForceOnly ? 0 : kStiffnessSamples;
  if (kind == Kind::kContact) {
    settings.samples = options.samples.value_or(ContactField::kMaxSamples);
    settings.stiffness_samples = 0;
    settings.kernel.constant_N2 = 0.0;
    Member member;
    member.field = std::make_unique<ContactField>(settings);
    names_[0] = name();
    members_.push_back(std::move(member));
    return;
  }
  if (kind != Kind::kBank) {
    add_member(name(), settings, 0);
    return;
  }
  settings.samples = kSamples;
  settings.stiffness_samples = kBankStiffnessSamples;
  struct Noise {
    const char* name;
    double nugget_N2;
  };
  for (const Noise& noise : {Noise{"smooth", 1e-5}, Noise{"exact", 1e-6}, Noise{"noisy", 1e-4},
                             Noise{"very noisy", 1e-3}}) {
    settings.nugget_N2 = noise.nugget_N2;
    add_member(noise.name, settings, 0);
  }
  FieldSettings kinks = settings;
  kinks.nugget_N2 = 1e-5;
  kinks.stiffness_samples = 0;
  kinks.kernel.shape = RadialShape::kMatern72;
  kinks.kernel.length_m = 0.015;
  add_member("kinks", kinks, 0);
  FieldSettings viscous = settings;
  viscous.samples = kHistorySamples;
  viscous.stiffness_samples = 0;
  viscous.nugget_N2 = 1e-5;
  viscous.kernel.history_gain = 0.03;
  add_member("slowly viscous", viscous, 0);
  viscous.kernel.history_gain = 1.0;
  add_member("viscous", viscous, 3);
  viscous.nugget_N2 = 1e-4;
  add_member("noisy viscous", viscous, 3);
  FieldSettings walls = settings;
  walls.nugget_N2 = kNugget_N2;
  walls.stiffness_samples = 0;
  add_hinge_member("walls", walls);
}

void KrigingMethod::add_member(const char* name, const FieldSettings& settings, int first_lag) {
  names_[members_.size()] = name;
  Member member;
  member.uses_history = settings.kernel.history_gain > 0.0;
  if (member.uses_history || settings.kernel.shape != RadialShape::kSquaredExponential) {
    member.handicap = kSpecialist;
  }
  member.first_lag = first_lag;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  if (member.uses_history) {
    member.field = std::make_unique<DictionaryField<float, kHistorySamples, 0>>(settings);
  } else if (settings.stiffness_samples > 0) {
    member.field = std::make_unique<DictionaryField<float, kSamples, kStiffnessSamples>>(settings);
  } else {
    member.field = std::make_unique<DictionaryField<float, kSamples, 0>>(settings);
  }
  members_.push_back(std::move(member));
}

void KrigingMethod::add_hinge_member(const char* name, const FieldSettings& settings) {
  names_[members_.size()] = name;
  Member member;
  member.field = std::make_unique<kriging::HingeField<float>>(settings);
  member.handicap = kSpecialist;
  member.finds_walls = true;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  members_.push_back(std::move(member));
}

void KrigingMethod::add_store_member(const char* name, const FieldSettings& settings) {
  names_[members_.size()] = name;
  kriging::SampleStore::Settings store;
  store.spacing = settings.spacing;
  store.nugget_N2 = settings.nugget_N2;
  store_ = std::make_unique<kriging::SampleStore>(store);
  Member member;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  member.field = std::make_unique<kriging::StoreField>(settings, *store_, true);
  members_.push_back(std::move(member));
}

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
  }
  return "invalid kind";
}

MethodNeeds KrigingMethod::needs() const noexcept {
  MethodNeeds needs;
  needs.stiffness = kind_ == Kind::kTangent;
  needs.requests_before_contact = kind_ == Kind::kContact;
  return needs;
}

std::size_t KrigingMethod::memory_bytes() const noexcept {
  std::size_t bytes =
      sizeof(*this) + history_.allocated_bytes() + members_.capacity() * sizeof(Member);
  for (const Member& member : members_) {
    bytes += member.field->memory_bytes();
  }
  return bytes + (store_ != nullptr ? store_->memory_bytes() : 0);
}

void KrigingMethod::take_sample(const Sample& sample) noexcept {
  // Only a field that tells places apart can use what was asked for before contact.
  const bool of_expected = sample.before_contact && sample.from_query && kind_ == Kind::kContact &&
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
      ++samples_skipped_;
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
  o.has_stiffness = sample.has_stiffness && sample.stiffness_W.allFinite();
  if (o.has_stiffness) {
    for (int i = 0; i < 6; ++i) {
      const int r = kriging::kStiffnessRow[i];
      const int c = kriging::kStiffnessColumn[i];
      o.stiffness_N_per_m[i] = 0.5 * (sample.stiffness_W(r, c) + sample.stiffness_W(c, r));
    }
  }
  if (sample.from_query) {
    entry.scored = false;
    return;
  }
  entry.lags_known = history_.find(sample.time_s, entry.lags);
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
  if ((position_W_ + kFollowAhead_s * velocity_W_ - followed_to_W_).norm() > kFollowFurther_m) {
    pieces_to_follow_ = kMostPieces;
  }
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
  contact_sampled_ = false;
  handed_over_N_.setZero();
  asked_.fill(Asked{});
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
  if (kind_ != Kind::kContact || in_contact_ || !std::isfinite(time_s) || !point_W.allFinite()) {
    return;
  }
  const bool another =
      !(time_s - expected_s_ < kExpected_s) || (point_W - origin_W_).norm() > kExpectedApart_m;
  expected_s_ = time_s;
  if (another) {
    ++contact_;
    set_origin(point_W);
    asked_.fill(Asked{});
  }
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

int KrigingMethod::take_one(Member& member) noexcept {
  const std::uint64_t number = member.next++;
  Queued& entry = queued(number);
  kriging::Observation observation = entry.observation;
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
  const auto index = static_cast<std::size_t>(&member - members_.data());
  entry.error_N2[index] = innovation.error_N * innovation.error_N;
  if (!observation.from_query) {
    member.surprises =
        kScoreKept * member.surprises + (innovation.surprised ? 1.0 - kScoreKept : 0.0);
  }
  if (member.finds_walls && innovation.explained && member.surprises < kCalm) {
    entry.wall_found = true;
    if (index != active_ && kTrusted * member.score_N2 < members_[active_].score_N2) {
      hand_over(index, ChoiceReason::kFoundWall);
    }
  }
  if (&member == &members_[active_]) {
    ++fits_;
    if (innovation.surprised || std::abs(innovation.scale - 1.0) > kScaleChanged) {
      surprised_fit_ = fits_;
    }
    contact_sampled_ = contact_sampled_ || (in_contact_ && number >= first_of_contact_);
    if (member.next == taken_) {
      pieces_to_follow_ = kMostPieces;
      if (store_ == nullptr) {  // else after what follows has been brought in
        update_uncertainty();
      }
    }
  }
  const int rows = member.field->row_count();
  return 1 + rows * rows / 2;
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
  return member.handicap * member.score_N2;
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
    std::size_t best = active_;
    for (std::size_t i = 0; i < members_.size(); ++i) {
      Member& member = members_[i];
      member.score_N2 = kScoreKept * member.score_N2 + (1.0 - kScoreKept) * entry.error_N2[i];
      if (member.finds_walls) {
        prove(member, entry);
      }
      if (rating(member) < rating(members_[best])) {
        best = i;
      }
    }
    if (best != active_ && rating(members_[best]) < kHysteresis * rating(members_[active_])) {
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

// Whether there may be something for the felt field to bring in.
bool KrigingMethod::may_follow() const noexcept {
  return store_ != nullptr && pieces_to_follow_ > 0 && in_contact_ && origin_known_ &&
         members_[active_].next == taken_;
}

// One piece of that, where the tool is going.
int KrigingMethod::follow() noexcept {
  const Eigen::Vector3d tool_W = observed_ ? position_W_ : newest_sample_W_;
  followed_to_W_ = tool_W + kFollowAhead_s * velocity_W_;
  kriging::Field& field = *members_[active_].field;
  const kriging::Followed followed = field.follow(tool_W - origin_W_, followed_to_W_ - origin_W_);
  fits_ += followed.changed ? 1 : 0;
  pieces_to_follow_ = followed.more ? pieces_to_follow_ - 1 : 0;
  if (pieces_to_follow_ == 0) {
    update_uncertainty();
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

bool KrigingMethod::plan_request(double time_s, const Eigen::Vector3d& position_W,
                                 Eigen::Vector3d& wanted_W) noexcept {
  if (!origin_known_ || !std::isfinite(time_s) || !position_W.allFinite()) {
    return false;
  }
  if (!in_contact_) {
    return plan_before_contact(time_s, wanted_W);
  }
  const Member& member = members_[active_];
  double best_N = 0.0;
  const auto consider = [&](Eigen::Vector3d candidate_W) {
    if (lattice_spacing_m_ > 0.0) {
      const Eigen::Vector3d corner_W = origin_W_ + lattice_corner_m_;
      candidate_W =
          corner_W + lattice_spacing_m_ *
                         ((candidate_W - corner_W) / lattice_spacing_m_).array().round().matrix();
    }
    if (asked_lately(time_s, candidate_W)) {
      return;
    }
    const double near_m2 = (candidate_W - position_W).squaredNorm();
    const double deviation_N =
        member.field->deviation_N(candidate_W - origin_W_, history_at(member, candidate_W));
    const double value_N = deviation_N * std::exp(-0.5 * near_m2 / (kAskReach_m * kAskReach_m));
    if (deviation_N > kAsk_N && value_N > best_N) {
      best_N = value_N;
      wanted_W = candidate_W;
    }
  };
  const double speed = velocity_W_.norm();
  for (const double periods : {1.0, 2.0, 3.0}) {
    const double ahead_m = std::min(periods * sample_period_s_ * speed, kAskFurthest_m);
    if (ahead_m > 0.0) {
      consider(position_W + ahead_m / speed * velocity_W_);
    }
  }
  // Where the motion may turn to: one place around the tool a call.
  const std::size_t around = next_around_++ % 6;
  Eigen::Vector3d beside_W = position_W;
  beside_W[static_cast<int>(around / 2)] += around % 2 == 0 ? kAskBeside_m : -kAskBeside_m;
  consider(beside_W);
  if (best_N <= 0.0) {
    return false;
  }
  note_asked(time_s, wanted_W);
  return true;
}

bool KrigingMethod::asked_lately(double time_s, const Eigen::Vector3d& candidate_W) const noexcept {
  return std::any_of(asked_.begin(), asked_.end(), [&](const Asked& asked) {
    return time_s - asked.time_s < kAskAgain_s &&
           (candidate_W - asked.position_W).norm() < kAskApart_m;
  });
}

void KrigingMethod::note_asked(double time_s, const Eigen::Vector3d& wanted_W) noexcept {
  asked_[next_asked_] = {time_s, wanted_W};
  next_asked_ = (next_asked_ + 1) % kAsked;
}

bool KrigingMethod::plan_before_contact(double time_s, Eigen::Vector3d& wanted_W) noexcept {
  const kriging::Field& field = *members_[active_].field;
  if (!(time_s - expected_s_ < kExpected_s) || !field.ready()) {
    return false;
  }
  for (const auto& displacement_m : kAskBefore_m) {
    const Eigen::Vector3d d(displacement_m);
    const Eigen::Vector3d candidate_W = origin_W_ + d;
    if (!asked_lately(time_s, candidate_W) &&
        field.deviation_N(d, kriging::History::Zero()) > kAsk_N) {
      wanted_W = candidate_W;
      note_asked(time_s, wanted_W);
      return true;
    }
  }
  return false;
}

}  // namespace forcegrid
