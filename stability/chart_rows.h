// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "stability/chart.h"

namespace forcegrid::stability {

/// A row as a JSON object; docs/stability.md explains the keys.
nlohmann::ordered_json to_json(const StabilityRow& row);
/// @throws nlohmann::json::exception if to_json() did not make `json`.
StabilityRow row_from_json(const nlohmann::ordered_json& json);

}  // namespace forcegrid::stability
