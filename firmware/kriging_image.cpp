// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "firmware/on_board_method.h"
#include "forcegrid/kriging/default_fields.h"
#include "forcegrid/kriging/kriging_method.h"

namespace forcegrid::firmware {

ForceMethod& make_method() noexcept {
  using Field = kriging::DictionaryField<float, kriging::kSmallSamples, 0>;
  kriging::FieldSettings settings;
  settings.nugget_N2 = kriging::kDefaultNugget_N2;
  settings.samples = kriging::kSmallSamples;
  return *new KrigingMethod(KrigingMethod::Kind::kForceOnly, kriging::least_uncertainty_N(settings),
                            std::make_unique<Field>(settings));
}

}  // namespace forcegrid::firmware
