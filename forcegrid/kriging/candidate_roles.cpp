// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/candidate_roles.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "forcegrid/kriging/contact_indexed_field.h"
#include "forcegrid/kriging/default_fields.h"
#include "forcegrid/kriging/kriging_store_field.h"
#include "forcegrid/kriging/kriging_terms.h"
#include "forcegrid/kriging/newest_field.h"
#include "forcegrid/kriging/unilateral_constraint_field.h"

namespace forcegrid::kriging {
namespace {

// The time constants of the force's path: those of the relaxation, and filters that never forget.
// The difference between the lags behind two of these is, but for a constant, what the second one
// lets through.
ToolHistory::TimeConstants force_time_constants_s() {
  constexpr double kNeverForgets_s = 1e9;
  ToolHistory::TimeConstants time_constants_s;
  time_constants_s.fill(kNeverForgets_s);
  std::copy(RelaxationField::kTimeConstants_s.begin(), RelaxationField::kTimeConstants_s.end(),
            time_constants_s.begin());
  return time_constants_s;
}

double least_of_others_N2(SquaredErrors errors_N2, std::size_t own) noexcept {
  double least_N2 = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < errors_N2.size(); ++i) {
    if (i != own) {
      least_N2 = std::min(least_N2, errors_N2[i]);
    }
  }
  return least_N2;
}

}  // namespace

ConstraintCandidate::ConstraintCandidate(const char* name, const FieldSettings& settings,
                                         const EnsembleThresholds& thresholds)
    : Candidate(name, std::make_unique<UnilateralConstraintField<float>>(settings),
                thresholds.specialist_weight, thresholds),
      surprises_(thresholds.score_kept) {}

bool ConstraintCandidate::on_taken(const Innovation& innovation, bool from_query) noexcept {
  if (!from_query) {
    surprises_.add(innovation.surprised);
    claimed_for_ = innovation.explained ? thresholds().walls_awake : std::max(0, claimed_for_ - 1);
  }
  return innovation.explained && surprises_.rate() < thresholds().wall_calm;
}

// A constraint is proven by samples that no candidate without it predicts well.
void ConstraintCandidate::on_evaluated(SquaredErrors errors_N2, std::size_t own) noexcept {
  const double others_N2 = least_of_others_N2(errors_N2, own);
  const double own_N2 = errors_N2[own];
  if (!field().knows_walls()) {
    proofs_ = 0;
    proven_before_ = false;
  } else if (own_N2 > thresholds().wall_refuted * others_N2 + thresholds().wall_refuted_N2) {
    proofs_ = std::max(0, proofs_ - thresholds().wall_proofs);
  } else if (own_N2 < thresholds().wall_proof * others_N2) {
    proofs_ = std::min(proofs_ + 1, 2 * thresholds().wall_proofs);
    proven_before_ = true;
  }
}

double ConstraintCandidate::rate(const Peers& /*peers*/) const noexcept {
  if (field().knows_walls() && proofs_ >= thresholds().wall_proofs) {
    return thresholds().wall_proven_weight * score_N2;
  }
  const bool credible = claimed_for_ > 0 || proven_before_;
  if (field().knows_walls() && credible && surprises_.rate() < thresholds().wall_calm) {
    return thresholds().wall_calm_weight * score_N2;
  }
  return weight() * score_N2;
}

MemoryCandidate::MemoryCandidate(const char* name, const FieldSettings& settings,
                                 const EnsembleThresholds& thresholds)
    : MemoryCandidate(name, settings, thresholds, make_store(settings)) {}

MemoryCandidate::MemoryCandidate(const char* name, const FieldSettings& settings,
                                 const EnsembleThresholds& thresholds,
                                 std::unique_ptr<SampleStore> store)
    : Candidate(name, std::make_unique<StoreField>(settings, *store, true), 1.0, thresholds),
      store_(std::move(store)),
      surprises_(thresholds.score_kept) {}

bool MemoryCandidate::on_taken(const Innovation& innovation, bool from_query) noexcept {
  if (!from_query) {
    surprises_.add(innovation.surprised);
  }
  return false;
}

double MemoryCandidate::rate(const Peers& /*peers*/) const noexcept {
  return (outdated() ? thresholds().specialist_weight : weight()) * score_N2;
}

std::size_t MemoryCandidate::memory_bytes() const noexcept {
  return Candidate::memory_bytes() + sizeof(*this) - sizeof(Candidate) + store_->memory_bytes();
}

UnfinishedCandidate::UnfinishedCandidate(const char* name, const FieldSettings& settings,
                                         const EnsembleThresholds& thresholds)
    : Candidate(name, std::make_unique<LagField>(settings), thresholds.specialist_weight,
                thresholds) {}

Candidate::Accept UnfinishedCandidate::accept(const QueuedSample& sample,
                                              const PathAtSample& /*path*/,
                                              Observation& /*observation*/) const noexcept {
  return !sample.before_contact && sample.observation.unfinished ? Accept::kTake : Accept::kNoUse;
}

double PathCandidate::rate(const Peers& peers) const noexcept {
  return is_proven(peers, peers.general_long_score_N2) ? score_N2 : weight() * score_N2;
}

HistoryCandidate::HistoryCandidate(const char* name, const FieldSettings& settings,
                                   const EnsembleThresholds& thresholds, const ToolHistory& path,
                                   int first_lag)
    : PathCandidate(name, make_dictionary_field(settings), thresholds.specialist_weight,
                    thresholds) {
  path_ = &path;
  first_lag_ = first_lag;
}

Candidate::Accept HistoryCandidate::accept(const QueuedSample& sample, const PathAtSample& path,
                                           Observation& observation) const noexcept {
  if (sample.before_contact) {
    return Accept::kNoUse;
  }
  if (sample.observation.from_query) {
    return Accept::kTake;  // as if the tool had rested there
  }
  if (!path.lags_known) {
    return Accept::kUnknown;
  }
  observation.history = path.lags.middleCols<kHistoryFeatures>(first_lag_).cast<double>();
  return Accept::kTake;
}

RelaxationCandidate::RelaxationCandidate(const char* name, const FieldSettings& settings,
                                         const EnsembleThresholds& thresholds, int velocity_lag,
                                         double velocity_lag_s)
    : PathCandidate(name, std::make_unique<RelaxationField>(settings), thresholds.specialist_weight,
                    thresholds),
      force_path_(force_time_constants_s()),
      velocity_lag_(velocity_lag),
      per_lag_(kViscousTerm_Ns_per_m / velocity_lag_s) {}

Candidate::Accept RelaxationCandidate::accept(const QueuedSample& sample, const PathAtSample& path,
                                              Observation& observation) const noexcept {
  if (sample.before_contact) {
    return Accept::kNoUse;
  }
  observation.terms_N = path.terms_N;
  return path.terms_known ? Accept::kTake : Accept::kUnknown;
}

std::size_t RelaxationCandidate::memory_bytes() const noexcept {
  return Candidate::memory_bytes() + sizeof(*this) - sizeof(Candidate) +
         force_path_.allocated_bytes();
}

PathTerms RelaxationCandidate::terms_N(const ToolHistory::Lags& tool_m,
                                       const ToolHistory::Lags& force_N) const noexcept {
  PathTerms terms_N;
  terms_N.col(0) = per_lag_ * tool_m.col(velocity_lag_).cast<double>();
  for (int j = 1; j < kPathTerms; ++j) {
    terms_N.col(j) = (force_N.rightCols<1>() - force_N.col(j - 1)).cast<double>();
  }
  return terms_N;
}

void RelaxationCandidate::observe(double time_s, const Eigen::Vector3d& rendered_N,
                                  const ToolHistory::Lags& tool_m) noexcept {
  force_path_.observe(time_s, rendered_N);
  field().observe(terms_N(tool_m, force_path_.now()));
}

bool RelaxationCandidate::find_terms(double time_s, const ToolHistory::Lags& tool_m,
                                     PathTerms& found_N) const noexcept {
  ToolHistory::Lags force_N;
  if (!force_path_.find(time_s, force_N)) {
    return false;
  }
  found_N = terms_N(tool_m, force_N);
  return true;
}

NewestCandidate::NewestCandidate(const char* name, const FieldSettings& settings,
                                 const EnsembleThresholds& thresholds)
    : Candidate(name, std::make_unique<NewestField>(settings), thresholds.specialist_weight,
                thresholds) {}

Candidate::Accept NewestCandidate::accept(const QueuedSample& sample, const PathAtSample& /*path*/,
                                          Observation& /*observation*/) const noexcept {
  return sample.before_contact || sample.observation.from_query ? Accept::kNoUse : Accept::kTake;
}

MovedCandidate::MovedCandidate(const char* name, const FieldSettings& settings,
                               const EnsembleThresholds& thresholds)
    : MovedCandidate(name, thresholds, std::make_unique<MovedField>(settings)) {}

MovedCandidate::MovedCandidate(const char* name, const EnsembleThresholds& thresholds,
                               std::unique_ptr<MovedField> field)
    : Candidate(name, std::move(field), thresholds.specialist_weight, thresholds),
      field_(static_cast<MovedField*>(&this->field())),
      surprises_(thresholds.score_kept, 1.0) {}

Candidate::Accept MovedCandidate::accept(const QueuedSample& sample, const PathAtSample& /*path*/,
                                         Observation& /*observation*/) const noexcept {
  return sample.before_contact || sample.observation.from_query ? Accept::kNoUse : Accept::kTake;
}

bool MovedCandidate::on_taken(const Innovation& innovation, bool from_query) noexcept {
  if (from_query) {
    return false;
  }
  const double left = field_->strength() / strength_;
  strength_ = field_->strength();
  // The first sample may have been of a small force.
  const bool refines = innovation.explained && claimed_ && left > thresholds().weaker_refined;
  surprises_.add(innovation.surprised && !refines);
  const bool claims = innovation.explained && surprises_.rate() < thresholds().wall_calm &&
                      (refines || left < thresholds().weaker_left);
  claimed_ = claims || (claimed_ && !innovation.surprised);
  return claims;
}

void MovedCandidate::on_evaluated(SquaredErrors errors_N2, std::size_t own) noexcept {
  const double others_N2 = least_of_others_N2(errors_N2, own);
  claimed_ = claimed_ && errors_N2[own] <= thresholds().wall_refuted * others_N2 +
                                               thresholds().wall_refuted_N2 + noise_N2();
}

double MovedCandidate::rate(const Peers& peers) const noexcept {
  const double others_N2 = std::min(peers.general_long_score_N2, peers.newest_long_score_N2);
  const bool proven = differs() && is_proven(peers, others_N2);
  return claimed_ || proven ? score_N2 : weight() * score_N2;
}

PlacesCandidate::PlacesCandidate(const char* name, const FieldSettings& settings,
                                 const EnsembleThresholds& thresholds)
    : Candidate(name, std::make_unique<ContactIndexedField>(settings), thresholds.places_weight,
                thresholds) {
  least_uncertainty_N_ = 0.0;
}

Candidate::Accept PlacesCandidate::accept(const QueuedSample& /*sample*/,
                                          const PathAtSample& /*path*/,
                                          Observation& /*observation*/) const noexcept {
  return Accept::kTake;
}

}  // namespace forcegrid::kriging
