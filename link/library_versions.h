// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::link {

/// Name and version, as loaded, of the libraries that seal and check datagrams.
/// Real-time: no. Threads: any.
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace forcegrid::link
