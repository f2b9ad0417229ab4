// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "forcegrid/core/method_options.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_store.h"

namespace forcegrid::kriging {

inline constexpr int kDefaultSamples = 32;
inline constexpr int kHistorySamples = 48;  ///< of fields with history features
inline constexpr double kDefaultNugget_N2 = 1e-5;

/// Nugget, samples and spacings of `options`, with the defaults filled in.
FieldSettings field_settings(const MethodOptions& options);

/// A DictionaryField of the smallest sizes that hold these settings.
std::unique_ptr<Field> make_dictionary_field(const FieldSettings& settings);

/// An empty store for a StoreField of these settings. SampleStore::allocated() is false if there
/// was not enough memory.
std::unique_ptr<SampleStore> make_store(const FieldSettings& settings);

/// [N] The least uncertainty of a force: half a sample's noise.
double least_uncertainty_N(const FieldSettings& settings);

}  // namespace forcegrid::kriging
