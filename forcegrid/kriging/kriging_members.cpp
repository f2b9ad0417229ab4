#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/contact_indexed_field.h"
#include "forcegrid/kriging/kriging_method.h"
#include "forcegrid/kriging/kriging_store_field.h"
#include "forcegrid/kriging/kriging_terms.h"
#include "forcegrid/kriging/unilateral_constraint.h"

namespace forcegrid {
namespace {

using kriging::ContactIndexedField;
using kriging::DictionaryField;
using kriging::FieldSettings;
using kriging::RadialShape;

constexpr int kSamples = 32;
constexpr int kHistorySamples = 48;
constexpr int kStiffnessSamples = 4;
constexpr int kBankStiffnessSamples = 2;
constexpr double kNugget_N2 = 1e-5;

constexpr double kLocal = 2.0;  // a little worse than others on a long contact

constexpr double kNeverForgets_s = 1e9;
constexpr int kRelaxationSamples = 24;

}  // namespace

KrigingMethod::KrigingMethod(Kind kind, const MethodOptions& options)
    : kind_(kind), history_(kTimeConstants_s) {
  members_.reserve(kMaxMembers);
  FieldSettings settings;
  settings.nugget_N2 = options.nugget.value_or(kNugget_N2);
  settings.samples = options.samples.value_or(kSamples);
  settings.spacing.metres = options.spacing_m.value_or(settings.spacing.metres);
  settings.spacing.newtons = options.spacing_N.value_or(settings.spacing.newtons);
  switch (kind) {
    case Kind::kForceOnly:
      add_member(name(), settings, 0);
      break;
    case Kind::kTangent:
      settings.stiffness_samples = kStiffnessSamples;
      add_member(name(), settings, 0);
      break;
    case Kind::kHinge:
      add_constraint_member(name(), settings);
      break;
    case Kind::kStore:
      add_store_member(name(), settings);
      break;
    case Kind::kContact:
      settings.samples = options.samples.value_or(ContactIndexedField::kMaxSamples);
      add_contact_member(name(), settings);
      break;
    case Kind::kBank:
      add_bank(settings);
      break;
    case Kind::kAuto:
      add_bank(settings);
      settings.samples = kSamples;
      settings.nugget_N2 = kNugget_N2;
      add_store_member("memory", settings);
      add_lag_member("unfinished", settings);
      add_relaxation_member("relaxing", settings);
      settings.samples = ContactIndexedField::kMaxSamples;
      add_contact_member("places", settings);
      break;
  }
}

void KrigingMethod::add_bank(FieldSettings settings) {
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
  if (kind_ == Kind::kBank) {
    add_member("kinks", kinks, 0);
  }
  FieldSettings viscous = settings;
  viscous.samples = kHistorySamples;
  viscous.stiffness_samples = 0;
  viscous.nugget_N2 = 1e-5;
  viscous.kernel.history_gain = 0.03;
  if (kind_ == Kind::kBank) {
    add_member("slowly viscous", viscous, 0);
  }
  viscous.kernel.history_gain = 1.0;
  add_member("viscous", viscous, 3);
  viscous.nugget_N2 = 1e-4;
  add_member("noisy viscous", viscous, 3);
  FieldSettings walls = settings;
  walls.nugget_N2 = kNugget_N2;
  walls.stiffness_samples = 0;
  add_constraint_member("walls", walls);
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

void KrigingMethod::add_constraint_member(const char* name, const FieldSettings& settings) {
  names_[members_.size()] = name;
  Member member;
  member.field = std::make_unique<kriging::UnilateralConstraintField<float>>(settings);
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
  follower_ = members_.size();
  Member member;
  member.keeps_all = kind_ == Kind::kAuto;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  member.field = std::make_unique<kriging::StoreField>(settings, *store_, true);
  members_.push_back(std::move(member));
}

void KrigingMethod::add_lag_member(const char* name, const FieldSettings& settings) {
  names_[members_.size()] = name;
  Member member;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  member.handicap = kSpecialist;
  member.only_unfinished = true;
  member.field = std::make_unique<kriging::LagField>(settings);
  members_.push_back(std::move(member));
}

void KrigingMethod::add_relaxation_member(const char* name, const FieldSettings& settings) {
  names_[members_.size()] = name;
  ToolHistory::TimeConstants time_constants_s;
  time_constants_s.fill(kNeverForgets_s);
  std::copy(kriging::RelaxationField::kTimeConstants_s.begin(),
            kriging::RelaxationField::kTimeConstants_s.end(), time_constants_s.begin());
  force_history_ = std::make_unique<ToolHistory>(time_constants_s);
  FieldSettings few = settings;
  few.samples = kRelaxationSamples;
  Member member;
  member.least_uncertainty_N = 0.5 * std::sqrt(settings.nugget_N2);
  member.handicap = kSpecialist;
  member.uses_terms = true;
  remembering_ = members_.size();
  member.field = std::make_unique<kriging::RelaxationField>(few);
  members_.push_back(std::move(member));
}

void KrigingMethod::add_contact_member(const char* name, FieldSettings settings) {
  names_[members_.size()] = name;
  settings.stiffness_samples = 0;
  settings.kernel.constant_N2 = 0.0;
  Member member;
  member.knows_places = true;
  member.handicap = kind_ == Kind::kAuto ? kLocal : 1.0;
  member.field = std::make_unique<ContactIndexedField>(settings);
  places_ = members_.size();
  members_.push_back(std::move(member));
}

}  // namespace forcegrid
