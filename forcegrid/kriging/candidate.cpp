// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/candidate.h"

#include <utility>

#include "forcegrid/kriging/default_fields.h"

namespace forcegrid::kriging {

Candidate::Candidate(const char* name, std::unique_ptr<Field> field, double weight,
                     const EnsembleThresholds& thresholds)
    : least_uncertainty_N_(kriging::least_uncertainty_N(field->settings())),
      name_(name),
      field_(std::move(field)),
      weight_(weight),
      thresholds_(thresholds) {}

Candidate::Accept Candidate::accept(const QueuedSample& sample, const PathAtSample& /*path*/,
                                    Observation& /*observation*/) const noexcept {
  // Only a field that distinguishes contact points can use answers to queries before a contact.
  return sample.before_contact ? Accept::kNoUse : Accept::kTake;
}

bool Candidate::on_taken(const Innovation& /*innovation*/, bool /*from_query*/) noexcept {
  return false;
}

void Candidate::on_evaluated(SquaredErrors /*errors_N2*/, std::size_t /*own*/) noexcept {}

double Candidate::rate(const Peers& /*peers*/) const noexcept { return weight_ * score_N2; }

void Candidate::on_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept {
  field_->enter_contact(contact, point_W);
}

std::size_t Candidate::memory_bytes() const noexcept {
  return sizeof(*this) + field_->memory_bytes();
}

History Candidate::history_at(const Eigen::Vector3d& position_W,
                              const Eigen::Vector3d& observed_W) const noexcept {
  History history = History::Zero();
  if (path_ != nullptr && !path_->empty()) {
    history = path_->now().middleCols<kHistoryFeatures>(first_lag_).cast<double>();
    history.colwise() += position_W - observed_W;
  }
  return history;
}

bool Candidate::is_proven(const Peers& peers, double others_N2) const noexcept {
  return peers.long_scored >= thresholds_.long_enough &&
         peers.general_long_score_N2 > thresholds_.path_wrong_N2 &&
         long_score_N2 < thresholds_.path_better_for_long * others_N2;
}

}  // namespace forcegrid::kriging
