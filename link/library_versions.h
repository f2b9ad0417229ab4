// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::link {

/// The libraries that datagrams are sealed and checked with, as loaded: name and version.
/// Real-time: no. Threads: any.
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace forcegrid::link
