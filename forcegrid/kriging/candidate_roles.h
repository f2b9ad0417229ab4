// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>

#include "forcegrid/kriging/candidate.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/kriging_store.h"
#include "forcegrid/kriging/moved_field.h"

namespace forcegrid::kriging {

/// `walls`: finds one-sided constraints (UnilateralConstraintField).
///
/// With a constraint it is right where no other candidate is, so its score counts less: by
/// wall_proven_weight once samples have proven the constraint, by wall_calm_weight while it is
/// seldom surprised. It claims a sample that a new constraint explains.
class ConstraintCandidate final : public Candidate {
 public:
  ConstraintCandidate(const char* name, const FieldSettings& settings,
                      const EnsembleThresholds& thresholds);
  bool on_taken(const Innovation& innovation, bool from_query) noexcept override;
  void on_evaluated(SquaredErrors errors_N2, std::size_t own) noexcept override;
  double rate(const Peers& peers) const noexcept override;
  bool served_early() const noexcept override { return true; }

 private:
  SurpriseRate surprises_;
  int proofs_ = 0;              ///< samples that only its constraint explains
  bool proven_before_ = false;  ///< by one of them, since it knows one
  int claimed_for_ = 0;         ///< samples after a claim in which proofs may come
};

/// `memory`: all samples in a store (StoreField). Old knowledge is doubtful for half a second after
/// a surprise: its score then counts as a specialist's.
class MemoryCandidate final : public Candidate {
 public:
  MemoryCandidate(const char* name, const FieldSettings& settings,
                  const EnsembleThresholds& thresholds);
  bool on_taken(const Innovation& innovation, bool from_query) noexcept override;
  double rate(const Peers& peers) const noexcept override;
  bool remembers() const noexcept override { return true; }
  std::size_t memory_bytes() const noexcept override;

  bool outdated() const noexcept { return surprises_.rate() > thresholds().outdated; }
  const SampleStore& store() const noexcept { return *store_; }

 private:
  MemoryCandidate(const char* name, const FieldSettings& settings,
                  const EnsembleThresholds& thresholds, std::unique_ptr<SampleStore> store);

  std::unique_ptr<SampleStore> store_;
  SurpriseRate surprises_;
};

/// `unfinished`: for a simulator that has not converged (LagField); takes only its samples.
class UnfinishedCandidate final : public Candidate {
 public:
  UnfinishedCandidate(const char* name, const FieldSettings& settings,
                      const EnsembleThresholds& thresholds);
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
};

/// A field that knows more than the position. It counts as a specialist until its long score is so
/// far below that of the general candidates that luck is no explanation.
class PathCandidate : public Candidate {
 public:
  using Candidate::Candidate;
  double rate(const Peers& peers) const noexcept final;
  bool knows_path() const noexcept final { return true; }
};

/// `viscous` and its kind: a dictionary with history features (Kernel::history_gain).
class HistoryCandidate final : public PathCandidate {
 public:
  /// @param path of the tool, which must outlive the candidate; `first_lag` the first of the
  ///   kHistoryFeatures lags that are its features.
  HistoryCandidate(const char* name, const FieldSettings& settings,
                   const EnsembleThresholds& thresholds, const ToolHistory& path, int first_lag);
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
};

/// `relaxing`: for objects that resist and relax (RelaxationField). Keeps the path of the rendered
/// force, from which the field computes its terms.
class RelaxationCandidate final : public PathCandidate {
 public:
  /// @param velocity_lag column of the tool's lags for the viscous term, and its time constant.
  RelaxationCandidate(const char* name, const FieldSettings& settings,
                      const EnsembleThresholds& thresholds, int velocity_lag,
                      double velocity_lag_s);
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
  std::size_t memory_bytes() const noexcept override;

  /// Call once per servo cycle with the rendered force and the tool's lags.
  void observe(double time_s, const Eigen::Vector3d& rendered_N,
               const ToolHistory::Lags& tool_m) noexcept;
  /// The terms at a sample's time, where `tool_m` are the tool's lags at that time.
  /// @returns false, with `found_N` unchanged, if that time was not observed.
  [[nodiscard]] bool find_terms(double time_s, const ToolHistory::Lags& tool_m,
                                PathTerms& found_N) const noexcept;

 private:
  PathTerms terms_N(const ToolHistory::Lags& tool_m,
                    const ToolHistory::Lags& force_N) const noexcept;

  ToolHistory force_path_;
  int velocity_lag_;
  double per_lag_;
};

/// `newest`: the newest sample and its stiffness (NewestField), for objects that change all the
/// time. Answers to queries are no news of the path.
class NewestCandidate final : public Candidate {
 public:
  NewestCandidate(const char* name, const FieldSettings& settings,
                  const EnsembleThresholds& thresholds);
  bool served_early() const noexcept override { return true; }  // it takes no time
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
};

/// `moved`: the same object, moved or weaker (MovedField). It claims a sample that a weaker object
/// explains, and its score counts once from then on until another candidate proves to be better, or
/// while its long score is far below that of the general candidates and of `newest`; else as a
/// specialist's.
class MovedCandidate final : public Candidate {
 public:
  MovedCandidate(const char* name, const FieldSettings& settings,
                 const EnsembleThresholds& thresholds);
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
  bool on_taken(const Innovation& innovation, bool from_query) noexcept override;
  void on_evaluated(SquaredErrors errors_N2, std::size_t own) noexcept override;
  /// What surprises nobody that is awake wakes nobody.
  void on_remembered() noexcept override { surprises_.add(false); }
  double rate(const Peers& peers) const noexcept override;
  ChoiceReason claim_reason() const noexcept override { return ChoiceReason::kWeaker; }
  bool differs() const noexcept override { return field_->has_changed(); }
  bool remembers() const noexcept override { return true; }
  bool claim_stands() const noexcept override { return claimed_; }

  /// Call once per servo cycle.
  void set_time(double time_s) noexcept { field_->set_time(time_s); }
  void scale_earlier_contacts(std::uint64_t contact, const ContactScale& scale) noexcept {
    field_->scale_earlier_contacts(contact, scale);
  }
  void expect_noise(double nugget_N2) noexcept { field_->expect_noise(nugget_N2); }

 private:
  MovedCandidate(const char* name, const EnsembleThresholds& thresholds,
                 std::unique_ptr<MovedField> field);

  MovedField* field_;
  double strength_ = 1.0;  ///< before the last sample
  SurpriseRate surprises_;
  bool claimed_ = false;
};

/// `places`: distinguishes contact points (ContactIndexedField), so it uses answers to queries
/// before a contact.
class PlacesCandidate final : public Candidate {
 public:
  PlacesCandidate(const char* name, const FieldSettings& settings,
                  const EnsembleThresholds& thresholds);
  Accept accept(const QueuedSample& sample, const PathAtSample& path,
                Observation& observation) const noexcept override;
};

}  // namespace forcegrid::kriging
