// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::simulator {

/// The library that workers are reached through, as loaded: name and version.
/// Real-time: no. Threads: any.
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace forcegrid::simulator
