// SPDX-License-Identifier: Apache-2.0
// The fields of KrigingMethod by name. Apart from the method, so that a device's own processor can
// have the method with one of them.
#include "forcegrid/kriging/contact_indexed_field.h"
#include "forcegrid/kriging/default_fields.h"
#include "forcegrid/kriging/kriging_method.h"
#include "forcegrid/kriging/kriging_store_field.h"
#include "forcegrid/kriging/unilateral_constraint_field.h"

namespace forcegrid {
namespace {

constexpr int kDefaultStiffnessSamples = 4;

}  // namespace

KrigingMethod::KrigingMethod(Kind kind, const MethodOptions& options) : kind_(kind) {
  make_field(options);
}

void KrigingMethod::make_field(const MethodOptions& options) {
  kriging::FieldSettings settings = kriging::field_settings(options);
  least_uncertainty_N_ = kriging::least_uncertainty_N(settings);
  switch (kind_) {
    case Kind::kForceOnly:
      field_ = kriging::make_dictionary_field(settings);
      break;
    case Kind::kTangent:
      settings.stiffness_samples = kDefaultStiffnessSamples;
      field_ = kriging::make_dictionary_field(settings);
      break;
    case Kind::kUnilateralConstraint:
      field_ = std::make_unique<kriging::UnilateralConstraintField<float>>(settings);
      break;
    case Kind::kStore:
      store_ = kriging::make_store(settings);
      field_ = std::make_unique<kriging::StoreField>(settings, *store_, true);
      break;
    case Kind::kContact:
      settings.samples = options.samples.value_or(kriging::ContactIndexedField::kMaxSamples);
      field_ = std::make_unique<kriging::ContactIndexedField>(settings);
      least_uncertainty_N_ = 0.0;
      break;
  }
}

}  // namespace forcegrid
