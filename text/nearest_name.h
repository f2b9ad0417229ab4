// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// The one of `names` that is the fewest edits away from `word`. An edit inserts, removes or
/// replaces a letter, or swaps two neighbours (optimal string alignment distance). Among equally
/// near names, the first; empty without names. Real-time: no. Threads: any.
std::string nearest_name(const std::string& word, const std::vector<std::string>& names);

}  // namespace forcegrid::text
