// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/solver/two_rates_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

/// Makes the contact of a tool that sticks to a TwoRatesObject.
/// Throws Error for a tool that slides, and for options out of range.
std::unique_ptr<ToolContact> make_two_rates_contact(const Scene& scene,
                                                    const TwoRatesOptions& solver,
                                                    const ToolOptions& options);

}  // namespace forcegrid::simulator
