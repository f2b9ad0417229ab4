#pragma once

#include <nlohmann/json.hpp>

#include "stability/chart.h"

namespace forcegrid::stability {

/// A row as an object whose keys docs/stability.md explains.
nlohmann::ordered_json to_json(const StabilityRow& row);
/// @throws nlohmann::json::exception for anything that to_json() did not make.
StabilityRow row_from_json(const nlohmann::ordered_json& json);

}  // namespace forcegrid::stability
