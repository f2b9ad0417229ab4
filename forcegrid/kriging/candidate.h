// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <utility>

#include "forcegrid/core/force_method.h"
#include "forcegrid/kriging/ensemble_thresholds.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/sample_queue.h"

namespace forcegrid::kriging {

/// The tool's path at a sample's time, looked up when the sample came.
struct PathAtSample {
  ToolHistory::Lags lags = ToolHistory::Lags::Zero();  ///< of the tool
  bool lags_known = false;
  PathTerms terms_N = PathTerms::Zero();
  bool terms_known = false;
};

/// The reference for rating a candidate's own score.
struct Peers {
  /// [N^2] Least long score of the candidates of weight one, which know the position alone.
  double general_long_score_N2 = 0.0;
  double newest_long_score_N2 = 0.0;  ///< [N^2] the same of `newest`
  std::uint64_t long_scored = 0;      ///< samples in the long scores
};

/// Squared errors [N^2] of all candidates at one sample; kNotTaken_N2 for those that do not use it.
using SquaredErrors = std::span<const double>;

/// One field of an ensemble, and its role: which samples it takes, how its score is rated, and what
/// a contact means to it.
///
/// A candidate takes the queued samples one by one at its own pace: next_sample() is the number of
/// the next one. So the ensemble may serve candidates in any order, leave one alone and let it
/// catch up later.
/// To add a role: derive, override what differs, and add it in make_candidates().
/// Real-time: nothing allocates, locks or throws after construction. Threads: one.
class Candidate {
 public:
  enum class Accept : std::uint8_t {
    kTake,
    kNoUse,    ///< not for this field; it is assumed to err like the rendered candidate
    kUnknown,  ///< its path was not observed: no candidate is scored by this sample
  };

  /// @param name static text.
  /// @param weight of its score, see EnsembleThresholds.
  Candidate(const char* name, std::unique_ptr<Field> field, double weight,
            const EnsembleThresholds& thresholds);
  virtual ~Candidate() = default;
  Candidate(const Candidate&) = delete;
  Candidate& operator=(const Candidate&) = delete;

  /// Whether its field takes a sample. A role may add what its field needs to `observation`.
  virtual Accept accept(const QueuedSample& sample, const PathAtSample& path,
                        Observation& observation) const noexcept;
  /// Called when its field has taken a sample.
  /// @returns true if it alone can explain the sample, so that no candidate is scored by it.
  virtual bool on_taken(const Innovation& innovation, bool from_query) noexcept;
  /// Called when all candidates have evaluated a sample. @param own its index in `errors_N2`.
  virtual void on_evaluated(SquaredErrors errors_N2, std::size_t own) noexcept;
  /// [N^2] The rating that decides: the least one wins.
  virtual double rate(const Peers& peers) const noexcept;
  /// A contact begins, or is expected, at `point_W`; reads are relative to it from now on.
  virtual void on_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept;
  /// Whether it takes a sample before candidates that are further behind.
  virtual bool served_early() const noexcept { return false; }
  /// Whether the force depends on more than the position.
  virtual bool knows_path() const noexcept { return false; }
  /// Whether it explained what no other can, and was right since.
  virtual bool claim_stands() const noexcept { return false; }
  /// Why it takes over when it alone explains a sample.
  virtual ChoiceReason claim_reason() const noexcept { return ChoiceReason::kFoundWall; }
  /// Whether it knows something of its own, for which it may be asked while all sleep.
  virtual bool differs() const noexcept { return true; }
  /// Called when its field has kept a sample while it sleeps.
  virtual void on_remembered() noexcept {}
  /// Whether its field keeps samples while it sleeps.
  virtual bool remembers() const noexcept { return false; }
  virtual std::size_t memory_bytes() const noexcept;

  const char* name() const noexcept { return name_; }
  Field& field() noexcept { return *field_; }
  const Field& field() const noexcept { return *field_; }
  double weight() const noexcept { return weight_; }
  /// [N^2] What noise adds to its squared errors at most, by what its field expects.
  double noise_N2() const noexcept {
    return thresholds_.noise_nuggets * field_->settings().nugget_N2;
  }
  double least_uncertainty_N() const noexcept { return least_uncertainty_N_; }

  /// The path's features at `position_W`, where `observed_W` is the tool's last observed position;
  /// zero for fields without such features.
  History history_at(const Eigen::Vector3d& position_W,
                     const Eigen::Vector3d& observed_W) const noexcept;

  /// The units of one piece of work on its field: half the square of the factor's rows.
  int piece_units() const noexcept {
    const int rows = field_->row_count();
    return 1 + rows * rows / 2;
  }

  std::uint64_t next_sample() const noexcept { return next_; }
  void advance() noexcept { ++next_; }
  /// Its field has begun to take sample `number`, and will know the result once it is ready.
  void expect_result(std::uint64_t number) noexcept { unfinished_ = number; }
  bool expects_result() const noexcept { return unfinished_ != kNone; }
  /// @returns the number of that sample.
  std::uint64_t take_result() noexcept { return std::exchange(unfinished_, kNone); }
  /// It has evaluated the samples before this one.
  std::uint64_t evaluated_until() const noexcept { return std::min(next_, unfinished_); }

  /// A candidate that sleeps takes no samples and is not scored.
  bool awake() const noexcept { return awake_; }
  void sleep() noexcept {
    awake_ = false;
    unfinished_ = kNone;
  }
  /// The next sample that it takes is `number`, which it has not taken yet.
  void wake(std::uint64_t number) noexcept {
    awake_ = true;
    next_ = number;
  }

  // Its errors so far, squared and averaged [N^2]: over some samples, over some seconds, and over
  // the first instants of contacts.
  double score_N2 = 0.0;
  double long_score_N2 = 0.0;
  /// [nats] How much less likely than the best one's its predictions made the samples, summed with
  /// forgetting; of those that know the position alone.
  double likelihood_nats = 0.0;
  bool scored_by_own = true;  ///< it took the sample that was scored last
  double first_touch_score_N2 = 0.0;
  int first_touches = 0;  ///< samples of its own in that average, which begins at zero

 protected:
  /// Whether its long score is so far below `others_N2` that luck is no explanation, where the
  /// general candidates are wrong.
  bool is_proven(const Peers& peers, double others_N2) const noexcept;
  const EnsembleThresholds& thresholds() const noexcept { return thresholds_; }
  double least_uncertainty_N_;
  const ToolHistory* path_ = nullptr;  ///< of fields with history features
  int first_lag_ = 0;                  ///< in path_, of the field's features

 private:
  const char* name_;
  std::unique_ptr<Field> field_;
  double weight_;
  const EnsembleThresholds& thresholds_;
  static constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();

  std::uint64_t next_ = 0;
  std::uint64_t unfinished_ = kNone;
  bool awake_ = true;
};

/// Share of recent samples that surprised a field, averaged as a score of ones and zeros.
class SurpriseRate {
 public:
  explicit SurpriseRate(double kept, double first = 0.0) noexcept : kept_(kept), rate_(first) {}
  void add(bool surprised) noexcept { rate_ = kept_ * rate_ + (surprised ? 1.0 - kept_ : 0.0); }
  double rate() const noexcept { return rate_; }

 private:
  double kept_;
  double rate_;
};

}  // namespace forcegrid::kriging
