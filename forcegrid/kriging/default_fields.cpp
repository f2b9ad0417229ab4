// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/default_fields.h"

#include <cmath>

namespace forcegrid::kriging {
namespace {

constexpr int kStiffnessSamples = 4;

}  // namespace

FieldSettings field_settings(const MethodOptions& options) {
  FieldSettings settings;
  settings.nugget_N2 = options.nugget.value_or(kDefaultNugget_N2);
  settings.samples = options.samples.value_or(kDefaultSamples);
  settings.spacing.metres = options.spacing_m.value_or(settings.spacing.metres);
  settings.spacing.newtons = options.spacing_N.value_or(settings.spacing.newtons);
  return settings;
}

std::unique_ptr<Field> make_dictionary_field(const FieldSettings& settings) {
  if (settings.kernel.history_gain > 0.0) {
    return std::make_unique<DictionaryField<float, kHistorySamples, 0>>(settings);
  }
  if (settings.stiffness_samples > 0) {
    return std::make_unique<DictionaryField<float, kDefaultSamples, kStiffnessSamples>>(settings);
  }
  return std::make_unique<DictionaryField<float, kDefaultSamples, 0>>(settings);
}

std::unique_ptr<SampleStore> make_store(const FieldSettings& settings) {
  SampleStore::Settings store;
  store.spacing = settings.spacing;
  store.nugget_N2 = settings.nugget_N2;
  return std::make_unique<SampleStore>(store);
}

double least_uncertainty_N(const FieldSettings& settings) {
  return 0.5 * std::sqrt(settings.nugget_N2);
}

}  // namespace forcegrid::kriging
