// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace forcegrid::driver {

/// The first line of a file, as those of sysfs have one value each; empty where it can't be read.
std::string first_line(const std::filesystem::path& file);

}  // namespace forcegrid::driver
