// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::driver {

/// The libraries that talk to devices, as loaded: name and version.
/// Real-time: no. Threads: any.
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace forcegrid::driver
