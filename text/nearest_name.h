// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// The one of `names` that is the fewest edits away from `word`: letters put in, left out,
/// exchanged for another, or two neighbours swapped (optimal string alignment distance). The first
/// of several that are equally near; empty without names. Real-time: no. Threads: any.
std::string nearest_name(const std::string& word, const std::vector<std::string>& names);

}  // namespace forcegrid::text
