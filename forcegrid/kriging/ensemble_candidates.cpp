// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/ensemble_candidates.h"

#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "forcegrid/kriging/contact_indexed_field.h"
#include "forcegrid/kriging/default_fields.h"
#include "forcegrid/kriging/work_budget.h"

namespace forcegrid::kriging {
namespace {

constexpr int kCandidateStiffnessSamples = 2;
constexpr int kRelaxationSamples = 24;
constexpr std::size_t kExact = 0;  // of the smooth ones
constexpr char kExactName[] = "exact";
constexpr double kExactNugget_N2 = 1e-6;
constexpr double kExactFittedShare = 0.3;
constexpr int kExactFewSamples = 8;
// Noise that makes samples of one place differ by more than their spacing allows would keep the
// outlying ones beside each other. Candidates for such noise tell places apart by more deviations.
constexpr double kNoiseApart = 12.0;
constexpr int kAveraged = 8;
constexpr int kSlowLags = 0;  // of kPathTimeConstants_s
constexpr int kFastLags = 3;
constexpr int kVelocityLag = 3;  // the shortest: the velocity times its time constant

class Builder {
 public:
  Builder(EnsembleKind kind, const MethodOptions& options, const EnsembleThresholds& thresholds,
          const ToolHistory& path)
      : kind_(kind), thresholds_(thresholds), path_(path), settings_(field_settings(options)) {
    settings_.samples = kDefaultSamples;
    settings_.nugget_N2 = kDefaultNugget_N2;
    candidates_.all.reserve(kMaxCandidates);
  }

  Candidates build(const BudgetPlan& plan) {
    if (!plan.ensemble) {
      settings_.stiffness_samples = kCandidateStiffnessSamples;
      settings_.nugget_N2 = kExactNugget_N2;
      settings_.fitted_share = kExactFittedShare;
      settings_.few_samples = kExactFewSamples;
      settings_.samples = plan.samples;
      add_plain(kExactName, settings_, 1.0);
      return std::move(candidates_);
    }
    add_smooth();
    add_viscous();
    candidates_.walls = candidates_.all.size();
    add<ConstraintCandidate>("walls", settings_, thresholds_);
    if (kind_ == EnsembleKind::kAuto) {
      candidates_.alone = kExact;
      candidates_.memory = candidates_.all.size();
      candidates_.memory_role = add<MemoryCandidate>("memory", settings_, thresholds_);
      candidates_.unfinished = candidates_.all.size();
      add<UnfinishedCandidate>("unfinished", settings_, thresholds_);
      FieldSettings few = settings_;
      few.samples = kRelaxationSamples;
      candidates_.relaxation =
          add<RelaxationCandidate>("relaxing", few, thresholds_, kVelocityLag,
                                   kPathTimeConstants_s[static_cast<std::size_t>(kVelocityLag)]);
      FieldSettings places = settings_;
      places.samples = ContactIndexedField::kMaxSamples;
      candidates_.places = candidates_.all.size();
      add<PlacesCandidate>("places", places, thresholds_);
      candidates_.newest = candidates_.all.size();
      add<NewestCandidate>("newest", settings_, thresholds_);
      FieldSettings moved = settings_;
      moved.nugget_N2 = kExactNugget_N2;
      moved.stiffness_samples = kCandidateStiffnessSamples;
      candidates_.moved = candidates_.all.size();
      candidates_.moved_role = add<MovedCandidate>("moved", moved, thresholds_);
    }
    return std::move(candidates_);
  }

 private:
  template <typename Role, typename... Arguments>
  Role* add(Arguments&&... arguments) {
    auto candidate = std::make_unique<Role>(std::forward<Arguments>(arguments)...);
    Role* added = candidate.get();
    candidates_.all.push_back(std::move(candidate));
    return added;
  }

  void add_plain(const char* name, const FieldSettings& settings, double weight) {
    add<Candidate>(name, make_dictionary_field(settings), weight, thresholds_);
  }

  void add_smooth() {
    struct Noise {
      const char* name;
      double nugget_N2;
      double fitted_share = 1.0;
      int few_samples = 1;
    };
    FieldSettings settings = settings_;
    settings.stiffness_samples = kCandidateStiffnessSamples;
    std::array<Noise, 4> noises{{{kExactName, kExactNugget_N2, kExactFittedShare, kExactFewSamples},
                                 {"smooth", 1e-5},
                                 {"noisy", 1e-4},
                                 {"very noisy", 1e-3}}};
    // The first one begins, and stays while the others sleep if it is nearly as good. Where nobody
    // sleeps, that is the one whose assumption fits most simulators.
    if (kind_ == EnsembleKind::kKriging) {
      std::swap(noises[0], noises[1]);
    }
    for (const Noise& noise : noises) {
      settings.nugget_N2 = noise.nugget_N2;
      settings.fitted_share = noise.fitted_share;
      settings.few_samples = noise.few_samples;
      settings.averaged_spacing.newtons = kNoiseApart * std::sqrt(noise.nugget_N2);
      settings.averaged =
          settings.averaged_spacing.newtons > settings.spacing.newtons ? kAveraged : 1;
      add_plain(noise.name, settings, 1.0);
    }
    if (kind_ == EnsembleKind::kKriging) {
      FieldSettings kinks = settings_;
      kinks.kernel.shape = RadialShape::kMatern72;
      kinks.kernel.length_m = 0.015;
      add_plain("kinks", kinks, thresholds_.specialist_weight);
    }
  }

  void add_viscous() {
    FieldSettings viscous = settings_;
    viscous.samples = kHistorySamples;
    if (kind_ == EnsembleKind::kKriging) {
      viscous.kernel.history_gain = 0.03;
      add<HistoryCandidate>("slowly viscous", viscous, thresholds_, path_, kSlowLags);
    }
    viscous.kernel.history_gain = 1.0;
    add<HistoryCandidate>("viscous", viscous, thresholds_, path_, kFastLags);
    viscous.nugget_N2 = 1e-4;
    add<HistoryCandidate>("noisy viscous", viscous, thresholds_, path_, kFastLags);
  }

  EnsembleKind kind_;
  const EnsembleThresholds& thresholds_;
  const ToolHistory& path_;
  FieldSettings settings_;
  Candidates candidates_;
};

}  // namespace

Candidates make_candidates(EnsembleKind kind, const MethodOptions& options,
                           const EnsembleThresholds& thresholds, const ToolHistory& path) {
  return Builder(kind, options, thresholds, path)
      .build(plan_for(kind == EnsembleKind::kAuto ? options.budget_reads : std::nullopt));
}

}  // namespace forcegrid::kriging
