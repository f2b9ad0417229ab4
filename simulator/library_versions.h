// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::simulator {

/// Name and version, as loaded, of the library that connects simulator and workers.
/// Real-time: no. Threads: any.
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace forcegrid::simulator
